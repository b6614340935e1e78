# The public names and where they live: the one list of them. `__init__.py` loads each when it is
# first used.
from .adapters import as_mesh as as_mesh
from .adapters.meshio_mesh import from_meshio as from_meshio
from .adapters.meshio_mesh import to_meshio as to_meshio
from .constraints import Constraints as Constraints
from .errors import MeshError as MeshError
from .errors import MeshWarning as MeshWarning
from .io import read_mesh as read_mesh
from .io import write_mesh as write_mesh
from .merging import merge as merge
from .mesh import Mesh as Mesh
from .methods.angle import Angle as Angle
from .methods.aspect_ratio import AspectRatio as AspectRatio
from .methods.laplacian import Laplacian as Laplacian
from .methods.quad import Quad as Quad
from .methods.smart_laplacian import SmartLaplacian as SmartLaplacian
from .methods.star import Star as Star
from .metrics import Limits as Limits
from .metrics import Quality as Quality
from .metrics import Summary as Summary
from .metrics import Validity as Validity
from .metrics import limits as limits
from .metrics import quality as quality
from .optimizer.method import Optimize as Optimize
from .optimizer.method import Untangle as Untangle
from .outcome import Outcome as Outcome
from .outcome import Stop as Stop
from .output.cell_quality import with_quality as with_quality
from .output.charts import plot_convergence as plot_convergence
from .output.charts import plot_histograms as plot_histograms
from .output.displacement import plot_displacement as plot_displacement
from .output.figures import plot_comparison as plot_comparison
from .output.figures import plot_mesh as plot_mesh
from .output.figures import plot_methods as plot_methods
from .output.report import report as report
from .remapping import transfer as transfer
from .result import History as History
from .result import SmoothResult as SmoothResult
from .result import SweepRecord as SweepRecord
from .session import Smoother as Smoother
from .session import StepRecord as StepRecord
from .smoothing import compare as compare
from .smoothing import smooth as smooth
from .smoothing import untangle as untangle
from .warming import warmup as warmup

__version__: str
