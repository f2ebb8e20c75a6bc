"""Language models as designers: prompts in, validated tasks and solver configs out; nothing they write is evaluated."""

from typing import TYPE_CHECKING

from gensim2.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.designers.llm.designer import LLMDesigner
    from gensim2.designers.llm.model import Model
    from gensim2.designers.llm.options import ModelOptions, model_options
    from gensim2.designers.llm.solutions import Asking, Mode, Views
    from gensim2.designers.llm.store import AnswerStore
    from gensim2.designers.llm.templating import Prompts

__all__ = [
    "AnswerStore",
    "Asking",
    "LLMDesigner",
    "Mode",
    "Model",
    "ModelOptions",
    "Prompts",
    "Views",
    "model_options",
]

# A report of a run reads what a model said without any of what it takes to ask one.
__getattr__ = lazy_names(
    __name__,
    {
        "AnswerStore": "gensim2.designers.llm.store",
        "Asking": "gensim2.designers.llm.solutions",
        "LLMDesigner": "gensim2.designers.llm.designer",
        "Mode": "gensim2.designers.llm.solutions",
        "Model": "gensim2.designers.llm.model",
        "ModelOptions": "gensim2.designers.llm.options",
        "Prompts": "gensim2.designers.llm.templating",
        "Views": "gensim2.designers.llm.solutions",
        "model_options": "gensim2.designers.llm.options",
    },
)
