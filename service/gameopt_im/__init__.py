"""The intersection manager: `gameopt-im`. Start reading at `service.py`."""

from gameopt_im.kernels import use_source_keyed_cache

use_source_keyed_cache()
