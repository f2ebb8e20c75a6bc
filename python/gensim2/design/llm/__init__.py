"""Use language models as designers. A model answers with tasks and solver configs, which are never run as code."""

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.design.llm.designer import LLMDesigner
    from gensim2.design.llm.model import LanguageModel
    from gensim2.design.llm.options import ModelOptions, model_options
    from gensim2.design.llm.solutions import Asking, Mode, Views
    from gensim2.design.llm.store import AnswerStore
    from gensim2.design.llm.templating import Prompts

__all__ = [
    "AnswerStore",
    "Asking",
    "LLMDesigner",
    "LanguageModel",
    "Mode",
    "ModelOptions",
    "Prompts",
    "Views",
    "model_options",
]

# Import lazily, so that a report can read recorded answers without the packages that contact a model.
__getattr__ = lazy_names(__name__)
