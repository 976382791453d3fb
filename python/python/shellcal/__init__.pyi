from ._calibration import Calibration as Calibration
from ._choice import choose_model as choose_model, cross_validate as cross_validate
from ._errors import (
    ArrayError as ArrayError,
    CountedTwiceError as CountedTwiceError,
    DocumentError as DocumentError,
    FitError as FitError,
    LogError as LogError,
    MergeError as MergeError,
    NotFittedError as NotFittedError,
    OptionError as OptionError,
    ProgramError as ProgramError,
    ShellcalError as ShellcalError,
    ShellcalWarning as ShellcalWarning,
)
from ._log import Table as Table, read_log as read_log
from ._native import __version__ as __version__
from ._partial import Partial as Partial, merge as merge, partial_fit as partial_fit
from ._program import (
    align as align,
    batch as batch,
    convert as convert,
    fit_logs as fit_logs,
    info as info,
    program as program,
    run as run,
    simulate as simulate,
    synth as synth,
    trial as trial,
)
from ._stream import (
    Frame as Frame,
    FrameBlock as FrameBlock,
    FrameStream as FrameStream,
    SimulatedBoard as SimulatedBoard,
    simulated_board as simulated_board,
    stream as stream,
)

__all__: list[str]
