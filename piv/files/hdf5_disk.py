"""HDF5 files on disks that may be full.

The library crashes, at once or when the process ends, of a write that fails. It therefore writes
through `Disk`, whose writes never fail: after a first failure they are dropped, and DiskFile's
`flush` and `close` raise the error.
"""

import io
import os
from pathlib import Path
from typing import Any

import h5py


class Disk(io.RawIOBase):
    """A file to write for h5py, xarray or h5netcdf: mode "w" (new) or "r+".

    It accepts every write; `check` and `close` raise the first error or interruption of one.
    """

    def __init__(self, path: str | Path, mode: str) -> None:
        self._path = path
        flags = os.O_CREAT | os.O_TRUNC if mode == "w" else 0
        self._descriptor = os.open(path, os.O_RDWR | flags, 0o666)
        self._position = 0
        self._end = os.fstat(self._descriptor).st_size
        self._reserved = 0
        self._failure: BaseException | None = None

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Behave as the method of any file does."""
        self._position = offset + {os.SEEK_CUR: self._position, os.SEEK_END: self._end}.get(
            whence, 0
        )
        return self._position

    def tell(self) -> int:
        """Behave as the method of any file does."""
        return self._position

    def readinto(self, buffer: Any) -> int:
        """Bytes from the disk; zeros beyond the end."""
        view = memoryview(buffer).cast("B")
        data = os.pread(self._descriptor, len(view), self._position)
        view[: len(data)] = data
        view[len(data) :] = bytes(len(view) - len(data))
        self._position += len(view)
        return len(view)

    def write(self, content: Any) -> int:
        """Write at the position, unless a write has failed."""
        view, written = memoryview(content).cast("B"), 0
        try:
            while self._failure is None and written < len(view):
                at = self._position + written
                written += os.pwrite(self._descriptor, view[written:], at)
        except (OSError, KeyboardInterrupt) as error:
            self._failure = error
        self._position += len(view)
        self._end = max(self._end, self._position)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the file's length."""
        self._end = self._position if size is None else size
        try:
            if self._failure is None:
                os.ftruncate(self._descriptor, self._end)
        except (OSError, KeyboardInterrupt) as error:
            self._failure = error
        return self._end

    def reserve(self, size: int) -> None:
        """Allocate the first `size` bytes; without room for them the disk stays as it is."""
        if size <= self._reserved or self._failure is not None:
            return
        before = os.fstat(self._descriptor).st_size
        try:
            os.posix_fallocate(self._descriptor, 0, size)
            self._reserved = size
        except (OSError, KeyboardInterrupt) as error:
            self._failure = error
            os.ftruncate(self._descriptor, before)

    def check(self) -> None:
        """Raise the first failure of a write."""
        if isinstance(self._failure, OSError):
            raise OSError(
                self._failure.errno, self._failure.strerror, str(self._path)
            ) from self._failure
        if self._failure is not None:
            raise self._failure

    def close(self) -> None:
        """Close the file; raise the first failure of a write."""
        if not self.closed:
            os.close(self._descriptor)
            super().close()
            self.check()


class DiskFile(h5py.File):
    """An HDF5 file to write: mode "w" or "r+"; `flush` and `close` raise an OSError of the disk.

    The disk then has the state of the last good `flush`, which allocates the room first.
    """

    def __init__(self, path: str | Path, mode: str, **options: Any) -> None:
        self._disk = Disk(path, mode)
        try:
            super().__init__(self._disk, mode, **options)
        except BaseException:
            self._disk.close()
            raise

    def flush(self) -> None:
        """Hand everything to the system."""
        self._disk.reserve(self.id.get_filesize())
        super().flush()
        self._disk.check()

    def close(self) -> None:
        """Write the rest and close the file."""
        if self:
            self._disk.reserve(self.id.get_filesize())
        super().close()
        self._disk.close()
