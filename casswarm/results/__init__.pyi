from .drawing import FigureFormat
from .folder import ResultsFolder
from .reports import simulation_page

__all__ = [
    "FigureFormat",
    "ResultsFolder",
    "simulation_page",
]
