"""Store everything that happens in a study as events, appended and never changed.

`StudyFile` is one SQLite file; its `State` follows from its events. docs/study_file.md describes
the format.
"""

from .archive import export_json as export_json
from .archive import import_json as import_json
from .codec import decode as decode
from .codec import encode as encode
from .events import Adjusted as Adjusted
from .events import Answered as Answered
from .events import Created as Created
from .events import Dialed as Dialed
from .events import Ended as Ended
from .events import Event as Event
from .events import Extended as Extended
from .events import Failed as Failed
from .events import Finished as Finished
from .events import Led as Led
from .events import Marked as Marked
from .events import Noted as Noted
from .events import Recorded as Recorded
from .events import Reopened as Reopened
from .events import Replaced as Replaced
from .events import Requested as Requested
from .events import Respaced as Respaced
from .events import Retracted as Retracted
from .events import Shown as Shown
from .events import Suggested as Suggested
from .events import Taken as Taken
from .events import Undone as Undone
from .events import to_text as to_text
from .exports import export_csv as export_csv
from .exports import export_parquet as export_parquet
from .file import StudyFile as StudyFile
from .fold import State as State
from .locations import data_folder as data_folder
from .locations import make_data_folder as make_data_folder
from .locations import remove_study as remove_study
from .locations import rename_study as rename_study
from .locations import studies_in_data_folder as studies_in_data_folder
from .locations import study_path as study_path
from .spaces import knobs_as_dicts as knobs_as_dicts
from .spaces import space_of as space_of
from .spaces import within_as_dict as within_as_dict
from .verify import verify as verify
