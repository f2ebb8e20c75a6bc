"""Query endpoints that speak the OpenAI protocol: hosted models, vLLM, Ollama, LM Studio and others.

``openai`` repeats failed requests, and ``boundary`` cleans replies. This client drops unsupported fields and explains
errors.
"""

from __future__ import annotations

import base64
import logging
import re
from typing import Any

from gensim2.core.errors import InputError, ModelError, one_line, required
from gensim2.design.llm.boundary import Boundary, guarded_client
from gensim2.design.llm.options import ModelOptions
from gensim2.design.llm.questions import Message, ModelAnswer, ModelQuestion

#: Estimated characters per token, for endpoints that do not count tokens.
CHARACTERS_A_TOKEN = 4

#: Estimated tokens of a picture, for endpoints that do not count tokens.
PICTURE_TOKENS = 1500

#: Token counts above this are invalid.
MAX_TOKENS = 10**9

#: Maximum number of characters that are kept of a model's name, or of a model's reason for a refusal.
LONGEST_REFUSAL = 300

#: Request fields that some endpoints refuse; a refused field is omitted from later requests.
OPTIONAL = ("response_format", "temperature", "max_tokens")


class Client:
    """Client that sends prompts to a model and returns its answers.

    Args:
        options: endpoint, model and request settings.

    Raises:
        MissingExtraError: the ``openai`` library is not installed.
        InputError: the address or the key cannot be used.
    """

    def __init__(self, options: ModelOptions) -> None:
        self.options = options
        self._openai, httpx = required("openai", "llm"), required("httpx2", "llm")
        # Silence these loggers: at the debug level they would print keys and uncleaned replies.
        for name in ("openai", "httpx", "httpx2", "httpcore", "httpcore2"):
            logging.getLogger(name).setLevel(logging.WARNING)
        self._key = options.key
        if self._key is not None and not self._key.can_be_sent:
            wrong = "is not a valid key: it contains spaces, line breaks or unusual characters"
            raise InputError(wrong, field=f"${options.key_variable}")
        self._url = options.address
        if self._key is None and self._url is None:
            remedy = f"set it, or name the endpoint of {options.model!r} with --base-url or $OPENAI_BASE_URL"
            raise InputError("is not set", field=f"${options.key_variable}", remedy=remedy)
        self._without: set[str] = {"response_format"} if options.structured == "off" else set()
        self._schema_works = False
        self._boundary = Boundary(self._key)
        try:
            line = guarded_client(httpx, self._boundary, options.timeout)
            self._api = self._openai.OpenAI(
                api_key=self._key.reveal() if self._key is not None else "none",
                base_url=self._url,
                timeout=options.timeout,
                max_retries=options.retries,
                http_client=line,
            )
        except (
            ValueError,
            TypeError,
            ImportError,
            self._openai.OpenAIError,
        ) as error:  # raised, for example, if the proxy settings are invalid
            wrong = f"no connection to the model can be made: {self._boundary.text(str(error))}"
            raise InputError(wrong, field="designer") from None

    @property
    def endpoint(self) -> str:
        """Address of the endpoint."""
        return str(self._api.base_url)

    def close(self) -> None:
        """Close the connections."""
        self._api.close()

    def models(self) -> list[str]:
        """Return the names of the models that the endpoint offers.

        Raises:
            ModelError: the endpoint does not answer.
            InputError: the endpoint refuses the key.
        """
        try:
            listed = self._api.with_options(max_retries=0).models.list()
            return [one_line(str(model.id))[:LONGEST_REFUSAL] for model in listed.data]
        except self._openai.OpenAIError as error:
            raise self._in_words(error) from error
        except (ValueError, TypeError, AttributeError) as error:
            raise ModelError(f"{self.endpoint}: the list of models is unreadable") from error

    def ask(self, question: ModelQuestion) -> ModelAnswer:
        """Return the model's answer to a question.

        Raises:
            ModelError: all attempts failed.
            InputError: the endpoint refuses the key, the model or the question.
        """
        messages = [_message(message) for message in question.messages]
        failed: InputError | ModelError | None = None
        while True:
            request = self._request(question, schema=failed is None)
            try:
                raw = self._api.chat.completions.with_raw_response.create(messages=messages, **request)
                if failed is not None:
                    self._without.add("response_format")
                self._schema_works |= "response_format" in request
                return self._answer(question, raw)
            except (self._openai.BadRequestError, self._openai.UnprocessableEntityError) as error:
                if (name := self._refused(request, _complaint(error))) is None:
                    raise self._in_words(error) from error
                self._without.add(name)
            except self._openai.InternalServerError as error:
                # Some servers report an internal error for a JSON schema. Therefore ask once more without the schema.
                if failed is not None or self._schema_works or "response_format" not in request:
                    raise failed or self._in_words(error) from error
                failed = self._in_words(error)
            except self._openai.OpenAIError as error:
                raise self._in_words(error) from error

    def _request(self, question: ModelQuestion, schema: bool) -> dict[str, Any]:
        given = self.options
        request: dict[str, Any] = {"model": given.model}
        if given.temperature is not None and "temperature" not in self._without:
            request["temperature"] = given.temperature
        limit = "max_completion_tokens" if "max_tokens" in self._without else "max_tokens"
        request[limit] = given.max_tokens
        if schema and "response_format" not in self._without:
            form = {"name": question.stage, "schema": question.schema}
            request["response_format"] = {"type": "json_schema", "json_schema": form}
        return request

    def _refused(self, request: dict[str, Any], complaint: str) -> str | None:
        """Return the optional request field that an endpoint's error message rejects; None if no field is rejected."""
        said = complaint.lower().replace("json_schema", "response_format").replace("response format", "response_format")
        return next((name for name in OPTIONAL if name in said and name in request), None)

    def _answer(self, question: ModelQuestion, raw: Any) -> ModelAnswer:
        try:
            choice = raw.parse().choices[0]
            text: Any = choice.message.content or ""
            finish, usage = choice.finish_reason, raw.parse().usage
            refusal = getattr(choice.message, "refusal", None)
        except (ValueError, TypeError, AttributeError, IndexError, RecursionError):
            return self._told(question, "", "it could not be read as a chat completion", None, raw.retries_taken)
        except self._openai.APIResponseValidationError:
            return self._told(question, "", "it could not be read as a chat completion", None, raw.retries_taken)
        problem: str | None
        if not isinstance(text, str):
            text, problem = "", "it was no text"
        elif not text.strip():
            said = f" ({one_line(str(refusal))[:LONGEST_REFUSAL]})" if refusal else ""
            problem = f"it was empty{said}"
        else:
            problem = "it was cut off because it was too long" if finish == "length" else None
        return self._told(question, text, problem, usage, raw.retries_taken)

    def _told(self, question: ModelQuestion, text: str, problem: str | None, usage: Any, retries: int) -> ModelAnswer:
        counts = (getattr(usage, "prompt_tokens", None), getattr(usage, "completion_tokens", None))
        counted = all(type(count) is int and 0 <= count <= MAX_TOKENS for count in counts)
        tokens_in, tokens_out = counts if counted else (estimated_tokens(question), len(text) // CHARACTERS_A_TOKEN)
        assert isinstance(tokens_in, int)
        assert isinstance(tokens_out, int)
        cost = self.options.priced(tokens_in, tokens_out)
        return ModelAnswer(text, problem, tokens_in, tokens_out, counted, retries, cost)

    def _in_words(self, error: Exception) -> InputError | ModelError:
        library, given = self._openai, self.options
        said = one_line(_complaint(error))
        if isinstance(error, library.AuthenticationError | library.PermissionDeniedError):
            missing = "is not set" if self._key is None else "holds a key that is refused"
            return InputError(missing, field=f"${given.key_variable}", remedy=f"set it to a key of {self.endpoint}")
        if isinstance(error, library.NotFoundError):
            message = f"{self.endpoint} has no model {given.model!r}: {said}"
            # If the error names the model, the address is right. Otherwise the remedy mentions both.
            known = given.model in said
            remedy = None if known else "check the model's name, and the end of --base-url, which is usually /v1"
            return InputError(message, field="designer", remedy=remedy)
        if isinstance(error, library.APITimeoutError):
            longer = "; if the model is slow, set a larger timeout in the file of --model-config"
            return ModelError(f"{self.endpoint}: no answer within {given.timeout:g} s, {self._tries()}{longer}")
        if isinstance(error, library.APIConnectionError):
            cause = one_line(str(error.__cause__ or error))
            return ModelError(f"{self.endpoint}: cannot be reached, {self._tries()}: {cause}")
        if isinstance(error, library.RateLimitError):
            return ModelError(f"{self.endpoint}: limits the request rate, {self._tries()}: {said}")
        if isinstance(error, library.APIStatusError) and 300 <= error.status_code < 400:
            remedy = "give the address itself with --base-url"
            return InputError(f"{self.endpoint} redirects to another address", field="designer", remedy=remedy)
        if isinstance(error, library.APIStatusError) and error.status_code < 500:
            longer = "serve the model with a longer context, or choose another model"
            remedy = longer if re.search(r"context (length|size|window)|prompt is too long", said) else None
            return InputError(f"{self.endpoint} refuses the request: {said}", field="designer", remedy=remedy)
        return ModelError(f"{self.endpoint}: {said}, {self._tries()}")

    def _tries(self) -> str:
        tries = self.options.retries + 1
        return f"tried {tries} times" if tries > 1 else "tried once"


def _complaint(error: Exception) -> str:
    """Return an error's message, with the response body if the message lacks it. The body often explains the error."""
    said, body = str(error), getattr(error, "body", None)
    return f"{said} - {body}" if body and " - " not in said else said


def estimated_tokens(question: ModelQuestion) -> int:
    """Estimate the number of tokens of a prompt."""
    characters = sum(len(message.text) for message in question.messages)
    pictures = sum(len(message.pictures) for message in question.messages)
    return characters // CHARACTERS_A_TOKEN + PICTURE_TOKENS * pictures + 1


def _message(message: Message) -> dict[str, Any]:
    if not message.pictures:
        return {"role": message.role, "content": message.text}
    parts: list[dict[str, Any]] = [{"type": "text", "text": message.text}]
    for picture in message.pictures:
        data = base64.b64encode(picture.make()).decode()
        parts.append({"type": "image_url", "image_url": {"url": f"data:image/png;base64,{data}"}})
    return {"role": message.role, "content": parts}
