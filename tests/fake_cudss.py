"""A library with the functions of cuDSS that the bindings call, on the memory of the host."""

import ctypes

import numpy as np
from scipy import sparse

from contact.condensation import device_schur
from skfem_adini.solvers import cudss, cudss_handles


class FakeCudss:
    """Functions of cuDSS 1.0 on the memory of the host."""

    def __init__(self):
        self.alive, self.calls, self.fail, self.keys = {}, [], {}, {}
        self.solved, self.error = [], 0.0  # columns of each solution, error of each solution
        self.jitter = 0.0  # by how much results vary but in the deterministic mode
        self.estimates = [0] * 16
        self.phases = []  # what was executed
        self.orders, self.trees = [], []  # what was handed over
        self.devices, self.installed = None, None  # of a handle for several, how many there are
        self.during = {}  # what happens while a phase runs, by its number

    def put_in_place(self, monkeypatch):
        """This library in the place of cuDSS, with NumPy in that of CuPy."""
        monkeypatch.setattr(cudss_handles, "load_cudss", lambda: self)
        monkeypatch.setattr(cudss_handles, "device_arrays", lambda: np)
        monkeypatch.setattr(cudss, "device_arrays", lambda: np)
        monkeypatch.setattr(device_schur, "device_arrays", lambda: np)
        monkeypatch.setattr(cudss_handles, "threading_layer", lambda: None)
        return self

    def __getattr__(self, name):
        if not name.startswith("cudss"):
            raise AttributeError(name)

        def call(*arguments):
            self.calls.append(name)
            if name in self.fail:
                return self.fail[name]
            if name.endswith("Destroy"):
                del self.alive[arguments[-1].value]
                return 0
            return getattr(self, "_" + name)(*arguments) or 0

        return call

    def _open(self, out, content=None):
        number = 1 + len(self.calls)
        self.alive[number] = content
        out._obj.value = number

    def _cudssCreate(self, out):
        self._open(out)

    def _cudssCreateMg(self, out, count, indices):
        self.devices = list(indices)
        assert len(self.devices) == count
        if self.installed is not None and max(self.devices) >= self.installed:
            return 3  # invalid value
        self._open(out)
        return 0

    def _cudssConfigCreate(self, out):
        self._open(out)

    def _cudssDataCreate(self, handle, out):
        assert handle.value in self.alive
        self._open(out, {})

    def _cudssConfigSet(self, config, key, value, size):
        if key == 22:
            self.keys[key] = list(value._obj)
            assert size.value == 4 * len(self.keys[key])
            return
        assert size.value == (8 if key == 12 else 4)
        self.keys[key] = value._obj.value

    def _cudssDataSet(self, handle, data, key, values, size):
        numbers = _memory(values, ctypes.c_int32, size.value // 4)
        if key == 18:
            self.alive[data.value]["marks"] = numbers.astype(bool)
        elif key == 9:
            self.orders.append(numbers.copy())
        elif key == 21:
            self.trees.append(numbers.copy())
        else:
            assert (key, size.value) == (23, 4)
            self.alive[data.value]["interrupt"] = numbers  # the place, which is read later

    def _cudssMatrixCreateCsr(self, out, rows, columns, nnz, start, end, index, data, *types):
        assert end is None
        assert types[:3] == (10, 10, 1)
        n, m = rows.value, nnz.value
        parts = (
            _memory(data, ctypes.c_double, m),
            _memory(index, ctypes.c_int32, m),
            _memory(start, ctypes.c_int32, n + 1),
        )
        self._open(out, [parts, types[3]])

    def _cudssMatrixSetValues(self, matrix, data):
        (before, index, start), kind = self.alive[matrix.value]
        parts = _memory(data, ctypes.c_double, len(before)), index, start
        self.alive[matrix.value] = [parts, kind]

    def _cudssMatrixCreateDn(self, out, rows, columns, stride, data, *types):
        assert types == (1, 0)
        assert stride.value == rows.value
        flat = _memory(data, ctypes.c_double, rows.value * columns.value)
        self._open(out, flat.reshape(columns.value, rows.value).T)

    def _cudssExecute(self, handle, phase, config, data, matrix, x, b):
        parts, kind = self.alive[matrix.value]
        n = len(parts[2]) - 1
        A = sparse.csr_array(parts, shape=(n, n)).toarray()
        if kind:  # an upper triangle
            A = A + np.triu(A, 1).T
        columns = self.alive[b.value].shape[1]
        self.phases.append(phase)
        self.alive[data.value]["upper"] = n * (n + 1) // 2  # entries of its dense factor
        if phase in self.during:
            self.during[phase]()
        interrupt = self.alive[data.value].get("interrupt", [0])
        if self.devices is not None and "interrupt" in self.alive[data.value]:
            return 4  # not supported for several devices
        if interrupt[0]:
            return 5  # execution failed
        if self.devices is not None:
            # The configuration must name the devices of the handle; no Schur mode, no repetition.
            assert self.keys[21] == len(self.devices)
            assert self.keys[22] == self.devices
            if self.keys.get(23) or self.keys[24] or self.keys.get(11):
                return 4
        if self.keys[24] and self.keys.get(11):
            return 4  # no hybrid memory in the deterministic mode
        if self.keys[24] and (self.keys[5] > 0 or columns > 1):
            return 4  # not supported in the deterministic mode
        if self.keys.get(23):
            kept = self.alive[data.value]
            return self._partial(phase, A, kind, kept, self.alive[b.value], self.alive[x.value])
        if phase in (4, 8):
            lowest = np.linalg.eigvalsh(A).min()
            self.info = int(kind == 3 and lowest <= 0)
        elif phase == 1008:
            self.solved.append(columns)
            noise = 1 + self.error * np.sin(np.arange(len(A)))[:, None]
            solution = noise * np.linalg.solve(A, self.alive[b.value])
            self.alive[x.value][...] = solution if self.keys[24] else solution * self._varied()
        else:
            assert phase == 3
        return 0

    def _partial(self, phase, A, kind, kept, b, x):
        """The Schur mode; the library's deterministic mode is wrong in it."""
        assert not self.keys[24]
        marks = kept["marks"]
        others, k = np.flatnonzero(~marks)[::-1], int(marks.sum())
        order, m = np.concatenate([others, np.flatnonzero(marks)]), len(A) - k
        P = A[np.ix_(order, order)]
        if phase in (4, 8):
            inner = P[:m, :m]
            singular = np.linalg.svd(inner, compute_uv=False).min(initial=1.0) < 1e-14
            self.info = int(kind == 3 and np.linalg.eigvalsh(inner).min() <= 0)
            self.pivots = int(kind == 0 and singular)
            if not (self.info or singular):
                kept["factor"] = inner, np.linalg.solve(inner, P[:m, m:]), P[m:, :m]
                kept["complement"] = (P[m:, m:] - P[m:, :m] @ kept["factor"][1]) * self._varied()
        elif phase == 48:
            inner, _, lower = kept["factor"]
            x[:m] = np.linalg.solve(inner, b[order[:m]])
            x[m:] = b[order[m:]] - lower @ x[:m]
        elif phase == 384:
            x[order[:m]] = b[:m] - kept["factor"][1] @ b[m:]
            x[order[m:]] = b[m:]
        else:
            assert phase == 3
        return 0

    def _varied(self):
        """A factor that is another one at each call."""
        return 1 + self.jitter * len(self.phases)

    def _cudssDataGet(self, handle, data, key, out, size, written):
        if key == 19:
            marked = int(self.alive[data.value]["marks"].sum())
            out._obj[:] = [marked, marked, marked**2]
            return
        if key == 2:
            out._obj.value = self.pivots
            return
        if key == 20:
            self.alive[out._obj.value][...] = self.alive[data.value]["complement"]
            return
        if key == 13:
            out._obj[:] = self.estimates
            return
        if key == 1:
            upper = self.alive[data.value]["upper"]
            out._obj.value = upper
            return
        assert key == 0
        out._obj.value = self.info


def _memory(pointer, kind, count):
    return np.ctypeslib.as_array(ctypes.cast(pointer, ctypes.POINTER(kind)), (count,))
