"""Store everything that happens in a study as events, appended and never changed.

`StudyFile` is one SQLite file; its `State` follows from its events. docs/study_file.md describes
the format.
"""

from .archive import export_csv as export_csv
from .archive import export_json as export_json
from .archive import export_parquet as export_parquet
from .archive import import_json as import_json
from .archive import verify as verify
from .file import StudyFile as StudyFile
from .file import data_folder as data_folder
from .file import make_data_folder as make_data_folder
from .file import remove_study as remove_study
from .file import rename_study as rename_study
from .file import studies_in_data_folder as studies_in_data_folder
from .file import study_path as study_path
from .fold import Adjusted as Adjusted
from .fold import Answered as Answered
from .fold import Concluded as Concluded
from .fold import Created as Created
from .fold import Dialed as Dialed
from .fold import Ended as Ended
from .fold import Event as Event
from .fold import Extended as Extended
from .fold import Failed as Failed
from .fold import Finished as Finished
from .fold import Kept as Kept
from .fold import Led as Led
from .fold import Marked as Marked
from .fold import Noted as Noted
from .fold import Recorded as Recorded
from .fold import Reopened as Reopened
from .fold import Replaced as Replaced
from .fold import Requested as Requested
from .fold import Respaced as Respaced
from .fold import Retracted as Retracted
from .fold import Shown as Shown
from .fold import State as State
from .fold import Suggested as Suggested
from .fold import Taken as Taken
from .fold import Undone as Undone
from .fold import decode as decode
from .fold import encode as encode
from .fold import knobs_as_dicts as knobs_as_dicts
from .fold import space_of as space_of
from .fold import to_text as to_text
from .fold import within_as_dict as within_as_dict
