"""Write the report of a study as a PDF of A4 pages, with nothing but matplotlib."""

from .document import FILE as FILE
from .document import document as document
