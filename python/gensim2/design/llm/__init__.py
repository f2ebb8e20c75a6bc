"""Language models as designers: prompts in, validated tasks and solver configs out; nothing they write is evaluated."""

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

# A report of a run reads what a model said without any of what it takes to ask one.
__getattr__ = lazy_names(__name__)
