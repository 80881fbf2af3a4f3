from .explanation import Explanation, explain

__all__ = ["Explanation", "explain"]
