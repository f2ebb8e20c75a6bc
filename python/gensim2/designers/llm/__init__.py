"""Language models as designers: prompts in, validated tasks and solver configs out; nothing they write is evaluated."""

from gensim2.designers.llm.designer import LLMDesigner
from gensim2.designers.llm.model import Model
from gensim2.designers.llm.options import ModelOptions, model_options
from gensim2.designers.llm.solutions import Asking, Mode, Views
from gensim2.designers.llm.store import AnswerStore
from gensim2.designers.llm.templating import Prompts

__all__ = ["AnswerStore", "Asking", "LLMDesigner", "Mode", "Model", "ModelOptions", "Prompts", "Views", "model_options"]
