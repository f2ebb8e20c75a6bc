"""Read options of a language model from a config file or the command line, and the API key from the environment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from gensim2.core.errors import InputError
from gensim2.core.validation import input_error
from gensim2.core.yaml_files import read_yaml
from gensim2.design.llm.boundary import Secret

Price = Annotated[float, Field(ge=0, le=1e6)]


class ModelOptions(BaseModel):
    """A model at an endpoint that speaks the OpenAI protocol, and the request settings.

    Attributes:
        model: name at the endpoint.
        base_url: address of the endpoint; None: ``$OPENAI_BASE_URL``, else OpenAI's address.
        key_variable: environment variable that holds the API key; self-hosted endpoints need no key.
        temperature: sampling temperature; None: default of the endpoint.
        max_tokens: maximum length of an answer, tokens.
        timeout: maximum seconds for one attempt, from the first byte sent to the last byte received.
        retries: number of retries after a failure of the endpoint or the network.
        concurrency: maximum number of concurrent requests.
        price_in, price_out: USD per million tokens of questions and answers; None: unknown.
        budget: maximum USD that a run may spend; None: no limit.
        structured: whether requests include a JSON schema; ``"auto"``: include a schema until the endpoint refuses it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())

    model: Annotated[str, Field(min_length=1, max_length=300)]
    base_url: Annotated[str, Field(max_length=2000)] | None = None
    key_variable: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=100)] = "OPENAI_API_KEY"
    temperature: Annotated[float, Field(ge=0, le=2)] | None = None
    max_tokens: Annotated[int, Field(ge=16, le=1_000_000)] = 4096
    timeout: Annotated[float, Field(gt=0, le=3600)] = 120.0
    retries: Annotated[int, Field(ge=0, le=20)] = 4
    concurrency: Annotated[int, Field(ge=1, le=64)] = 4
    price_in: Price | None = None
    price_out: Price | None = None
    budget: Annotated[float, Field(gt=0, le=1e6)] | None = None
    structured: Literal["auto", "off"] = "auto"

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.budget is not None and (self.price_in is None or self.price_out is None):
            raise ValueError("budget: a budget requires price_in and price_out (USD per million tokens)")
        if self.base_url is not None:
            problem = problem_of_address(self.base_url)
            if problem is not None:
                raise ValueError(f"base_url: {problem}")
        return self

    @property
    def key(self) -> Secret | None:
        """Return the API key from the environment, or None."""
        found = os.environ.get(self.key_variable)
        return Secret(found) if found else None

    @property
    def address(self) -> str | None:
        """Return the address of the endpoint, which is ``OPENAI_BASE_URL`` by default. None means OpenAI's own address.

        Raises:
            InputError: the address is invalid, or it contains credentials, a query or a fragment.
        """
        found = self.base_url or os.environ.get("OPENAI_BASE_URL") or None
        problem = problem_of_address(found) if found is not None else None
        if problem is not None:
            raise InputError(problem, field="$OPENAI_BASE_URL")
        return found

    def priced(self, tokens_in: int, tokens_out: int) -> float | None:
        """Return the cost of these tokens in USD; None if the prices are unknown."""
        if self.price_in is None or self.price_out is None:
            return None
        return (tokens_in * self.price_in + tokens_out * self.price_out) / 1e6


def problem_of_address(address: str) -> str | None:
    """Return the fault of an endpoint's address as text, or None. The text never contains the address's credentials."""
    try:
        parts = urlsplit(address)
        _ = parts.port  # raises ValueError if the port is invalid
    except ValueError:
        return "is no http or https address"
    if parts.password or parts.username or parts.query or parts.fragment:
        return "holds more than an address; the key comes from the environment"
    if parts.scheme not in ("http", "https") or not parts.hostname or not (address.isascii() and address.isprintable()):
        return f"{address!r} is no http or https address"
    return None


def model_options(config: Path | None = None, **given: Any) -> ModelOptions:
    """Read options from a YAML file; ``given`` overrides its fields.

    Args:
        config: YAML file with fields of :class:`ModelOptions`, or None.
        **given: fields that override the file; None: not given.

    Raises:
        InputError: a field is unknown, missing or out of range; the message names file and field.
    """
    fields: Mapping[str, Any] = read_yaml(config) if config is not None else {}
    try:
        return ModelOptions.model_validate({**fields, **{k: v for k, v in given.items() if v is not None}})
    except ValidationError as error:
        raise input_error(error, file=config, known=ModelOptions.model_fields) from error
