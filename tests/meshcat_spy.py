"""A Meshcat that remembers what it is told."""

from pydrake.geometry import Meshcat, MeshcatParams


class MeshcatSpy(Meshcat):
    """Keeps the last transform, property, solid and mesh of each path, and what was recorded."""

    def __init__(self):
        super().__init__(MeshcatParams(host="127.0.0.1"))
        self.transforms, self.properties, self.objects, self.meshes = {}, {}, {}, {}
        self.camera = None  # Position and target.
        self.recorded = {}  # (path, property or "transform") -> [(time, value)].

    def SetTransform(self, path, X, time=None):
        self.transforms[path] = X
        self._record(path, "transform", X, time)
        super().SetTransform(path, X, time)

    def SetProperty(self, path, name, value, time=None):
        self.properties[path, name] = value
        self._record(path, name, value, time)
        super().SetProperty(path, name, value, time)

    def _record(self, path, name, value, time):
        if time is not None:
            self.recorded.setdefault((path, name), []).append((time, value))

    def SetObject(self, path, shape, color):
        self.objects[path] = shape, color
        super().SetObject(path, shape, color)

    def SetTriangleMesh(self, path, vertices, faces, color):
        self.meshes[path] = vertices, faces, color
        super().SetTriangleMesh(path, vertices, faces, color)

    def SetCameraPose(self, position, target):
        self.camera = position, target
        super().SetCameraPose(position, target)

    def click(self, name):
        """Clicks a button, as somebody at the page does."""
        text = bytes([0xA0 + len(name)]) + name.encode()  # MessagePack.
        self._InjectWebsocketMessage(b"\x82\xa4type\xa6button\xa4name" + text)
