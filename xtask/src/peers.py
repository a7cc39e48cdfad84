"""Traces the rays that `peer_scene` wrote with Mitsuba 3: Embree on the CPU (llvm_ad_rgb), OptiX on a card (cuda_ad_rgb).

usage: peers.py VARIANT FOLDER SECONDS
Prints one line of JSON: milliseconds a frame (median), build in seconds, shares of rays that hit, and how the distances
compare with Emboss's.
"""
import json
import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np

variant, folder, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
mi.set_variant(variant)
positions = np.fromfile(f"{folder}/positions.f32", np.float32)
faces = np.fromfile(f"{folder}/faces.u32", np.uint32)
rays = np.fromfile(f"{folder}/rays.f32", np.float32).reshape(-1, 6)
expected = np.fromfile(f"{folder}/hits.f32", np.float32)

start = time.perf_counter()
mesh = mi.Mesh("model", vertex_count=len(positions) // 3, face_count=len(faces) // 3)
parameters = mi.traverse(mesh)
parameters["vertex_positions"] = mi.Float(positions)
parameters["faces"] = mi.UInt32(faces)
parameters.update()
scene = mi.load_dict({"type": "scene", "model": mesh})
dr.sync_thread()
build = time.perf_counter() - start

columns = [mi.Float(np.ascontiguousarray(rays[:, i])) for i in range(6)]
ray = mi.Ray3f(mi.Point3f(*columns[:3]), mi.Vector3f(*columns[3:]))
dr.eval(ray)
dr.sync_thread()


def frame():
    """Nearest hits of all rays; without shading."""
    found = scene.ray_intersect_preliminary(ray, coherent=True)
    t = found.t
    dr.eval(t)
    dr.sync_thread()
    return t


for _ in range(4):
    t = np.array(frame())
times = []
is_device = variant.startswith("cuda")
dr.set_flag(dr.JitFlag.KernelHistory, is_device)
until = time.perf_counter() + seconds
while len(times) < 10 or time.perf_counter() < until:
    start = time.perf_counter()
    frame()
    elapsed = (time.perf_counter() - start) * 1e3
    if is_device:
        # The device's own clock, without the host's calls.
        elapsed = sum(kernel["execution_time"] for kernel in dr.kernel_history() if kernel.get("uses_optix"))
        dr.kernel_history_clear()
    times.append(elapsed)

hit, ours = np.isfinite(t), np.isfinite(expected)
both = hit & ours
difference = np.abs(t[both] / expected[both] - 1) if both.any() else np.zeros(1)
print(
    json.dumps(
        {
            "triangles": len(faces) // 3,
            "build_s": build,
            "ms": float(np.median(times)),
            "hit": float(hit.mean()),
            "only_ours": int((ours & ~hit).sum()),
            "only_theirs": int((hit & ~ours).sum()),
            "far_apart": int((difference > 1e-4).sum()),
            "version": mi.__version__,
        }
    )
)
