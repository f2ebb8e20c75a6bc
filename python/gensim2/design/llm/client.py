"""The one client for all endpoints that speak the OpenAI protocol: hosted models, vLLM, Ollama, LM Studio and others.

Back-off, Retry-After and time-outs are the ``openai`` library's. Added here: a limit on the size and on the whole time
of an answer, doing without what an endpoint does not know, and errors that a user can act on and that hold no key.
"""

from __future__ import annotations

import base64
import importlib
import logging
import os
import time
from collections.abc import Iterator
from typing import Any

from gensim2.design.llm.options import ModelOptions
from gensim2.design.llm.questions import Answer, Message, Question
from gensim2.errors import InputError, MissingExtraError, ModelError

#: Bytes of the longest reply of an endpoint that is read; what is beyond is left in the line.
MOST_BYTES = 4_000_000

#: Characters that make a token where an endpoint does not count them.
CHARACTERS_A_TOKEN = 4

#: Tokens that a picture is taken for where nobody counts.
PICTURE_TOKENS = 1500

#: Fields of a request that some endpoints refuse; they are left out from then on.
OPTIONAL = ("response_format", "temperature", "max_tokens")


class Client:
    """Asks one model.

    Args:
        options: which, and how.

    Raises:
        MissingExtraError: the ``openai`` library is not installed.
        InputError: the address or the key cannot be used.
    """

    def __init__(self, options: ModelOptions) -> None:
        self.options = options
        self._openai = _load("openai")
        self._httpx = _load("httpx2")
        for name in ("openai", "httpx", "httpx2"):  # with OPENAI_LOG=debug they would show whole requests
            logging.getLogger(name).setLevel(logging.WARNING)
        self._key = options.key
        if self._key is not None and not (self._key.isascii() and self._key.isprintable() and " " not in self._key):
            raise InputError("holds no key: spaces, line breaks or odd characters", field=f"${options.key_variable}")
        if self._key is None and options.base_url is None and not os.environ.get("OPENAI_BASE_URL"):
            remedy = f"set it, or name the endpoint of {options.model!r} with --base-url or $OPENAI_BASE_URL"
            raise InputError("is not set", field=f"${options.key_variable}", remedy=remedy)
        self._without: set[str] = {"response_format"} if options.structured == "off" else set()
        self._api = self._openai.OpenAI(
            api_key=self._key or "none",
            base_url=options.base_url,
            timeout=options.timeout,
            max_retries=options.retries,
            http_client=self._openai.DefaultHttpxClient(
                timeout=options.timeout,
                headers={"Accept-Encoding": "identity"},  # what is small on the line stays small
                event_hooks={"response": [self._bounded]},
            ),
        )

    @property
    def endpoint(self) -> str:
        """Its address."""
        return str(self._api.base_url)

    def close(self) -> None:
        """Give the connections back."""
        self._api.close()

    def models(self) -> list[str]:
        """Names of the models that the endpoint offers.

        Raises:
            ModelError: there is no answer.
            InputError: the endpoint refuses the key.
        """
        try:
            return [model.id for model in self._api.with_options(max_retries=0).models.list()]
        except self._openai.OpenAIError as error:
            raise self._in_words(error) from error
        except (ValueError, TypeError, AttributeError) as error:
            raise ModelError(f"{self.endpoint}: lists its models in no way that can be read") from error

    def ask(self, question: Question) -> Answer:
        """One answer.

        Raises:
            ModelError: there is none, after all tries.
            InputError: the endpoint refuses the key, the model or the question.
        """
        messages = [_message(message) for message in question.messages]
        while True:
            request = self._request(question)
            try:
                raw = self._api.chat.completions.with_raw_response.create(messages=messages, **request)
                return self._answer(question, raw)
            except self._openai.BadRequestError as error:
                if (name := self._refused(request, str(error))) is None:
                    raise self._in_words(error) from error
                self._without.add(name)
            except self._openai.OpenAIError as error:
                raise self._in_words(error) from error

    def _request(self, question: Question) -> dict[str, Any]:
        given = self.options
        request: dict[str, Any] = {"model": given.model}
        if given.temperature is not None and "temperature" not in self._without:
            request["temperature"] = given.temperature
        limit = "max_completion_tokens" if "max_tokens" in self._without else "max_tokens"
        request[limit] = given.max_tokens
        if "response_format" not in self._without:
            schema = {"name": question.stage, "schema": question.schema}
            request["response_format"] = {"type": "json_schema", "json_schema": schema}
        return request

    def _refused(self, request: dict[str, Any], complaint: str) -> str | None:
        """Which field of a request that can be done without the endpoint complains of."""
        said = complaint.lower().replace("json_schema", "response_format").replace("response format", "response_format")
        return next((name for name in OPTIONAL if name in said and name in request), None)

    def _answer(self, question: Question, raw: Any) -> Answer:
        try:
            choice = raw.parse().choices[0]
            text: Any = choice.message.content or ""
            finish, usage = choice.finish_reason, raw.parse().usage
            refusal = getattr(choice.message, "refusal", None)
        except (ValueError, TypeError, AttributeError, IndexError, RecursionError):
            # No chat completion, or one that was cut off: whatever it was meant to say, nobody can tell.
            return self._told(question, "", "it could not be read as a chat completion", None, raw.retries_taken)
        except self._openai.APIResponseValidationError:
            return self._told(question, "", "it could not be read as a chat completion", None, raw.retries_taken)
        problem: str | None
        if not isinstance(text, str):
            text, problem = "", "it was no text"
        elif not text.strip():
            problem = f"it was empty{f' ({refusal})' if refusal else ''}"
        else:
            problem = "it was cut off because it was too long" if finish == "length" else None
        return self._told(question, text, problem, usage, raw.retries_taken)

    def _told(self, question: Question, text: str, problem: str | None, usage: Any, retries: int) -> Answer:
        counts = (getattr(usage, "prompt_tokens", None), getattr(usage, "completion_tokens", None))
        counted = all(isinstance(count, int) and count >= 0 for count in counts)
        tokens_in, tokens_out = counts if counted else (estimated_tokens(question), len(text) // CHARACTERS_A_TOKEN)
        assert isinstance(tokens_in, int)
        assert isinstance(tokens_out, int)
        cost = self.options.priced(tokens_in, tokens_out)
        return Answer(self._without_key(text), problem, tokens_in, tokens_out, counted, retries, cost)

    def _in_words(self, error: Exception) -> InputError | ModelError:
        """The library's error as one of ours, without the key, which endpoints like to repeat."""
        library, given = self._openai, self.options
        said = self._without_key(str(error))
        if isinstance(error, library.AuthenticationError | library.PermissionDeniedError):
            missing = "is not set" if self._key is None else "holds a key that is refused"
            return InputError(missing, field=f"${given.key_variable}", remedy=f"set it to a key of {self.endpoint}")
        if isinstance(error, library.NotFoundError):
            return InputError(f"{self.endpoint} has no model {given.model!r}: {said}", field="designer")
        if isinstance(error, library.APITimeoutError):
            return ModelError(f"{self.endpoint}: no answer within {given.timeout:g} s, {self._tries()}")
        if isinstance(error, library.APIConnectionError):
            cause = self._without_key(str(error.__cause__ or error))
            return ModelError(f"{self.endpoint}: cannot be reached, {self._tries()}: {cause}")
        if isinstance(error, library.RateLimitError):
            return ModelError(f"{self.endpoint}: asks to be left alone, {self._tries()}: {said}")
        if isinstance(error, library.APIStatusError) and error.status_code < 500:
            return InputError(f"{self.endpoint} refuses the question: {said}", field="designer")
        return ModelError(f"{self.endpoint}: {said}, {self._tries()}")

    def _tries(self) -> str:
        tries = self.options.retries + 1
        return f"tried {tries} times" if tries > 1 else "tried once"

    def _without_key(self, text: str) -> str:
        return text.replace(self._key, "***") if self._key else text

    def _bounded(self, response: Any) -> None:
        """Let no reply be longer than ``MOST_BYTES`` or take longer than ``timeout`` as a whole."""
        inner, until, timed_out = response.stream, time.monotonic() + self.options.timeout, self._httpx.ReadTimeout

        class Bounded(self._httpx.SyncByteStream):  # type: ignore[misc, name-defined]
            def __iter__(self) -> Iterator[bytes]:
                read = 0
                for chunk in inner:
                    if time.monotonic() > until:
                        raise timed_out("the answer took too long")
                    yield chunk[: MOST_BYTES - read]
                    read += len(chunk)
                    if read >= MOST_BYTES:
                        return

            def close(self) -> None:
                inner.close()

        response.stream = Bounded()


def estimated_tokens(question: Question) -> int:
    """What a question is about as long as, in tokens."""
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


def _load(module: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(module, "llm") from error
