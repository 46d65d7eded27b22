#!/bin/sh
# The kernels' compiler uses its cache only where it may write, and the image's file system may be read-only.
set -e
[ -d "$NUMBA_CACHE_DIR" ] || cp -r /opt/gameopt/kernels "$NUMBA_CACHE_DIR"
exec "$@"
