"""The corpus as a table: a line for every folder, and one for every scene that goes out again."""

import re
import shutil
from collections import namedtuple

import pycolmap

import colmap
import others
import returns
import scenes
import transforms

Case = namedtuple("Case", "program file what format build returns", defaults=[False])

COLMAP = f"COLMAP {pycolmap.__version__.split('+')[0]} (pycolmap)"
TEXT, BINARY = "text model", "binary model"
NERFSTUDIO, NGP, OPENMVG = "nerfstudio 1.1, `ns-process-data`", "instant-ngp, `colmap2nerf.py`", "OpenMVG"
TRANSFORMS, SFM_DATA = "`transforms.json`", "`sfm_data.json`"


def of_colmap():
    for binary, file in ((False, TEXT), (True, BINARY)):
        def case(what, build, sent=False):
            return Case(COLMAP, file, what, "colmap", build, sent)

        for model in colmap.LENSES:
            yield case(f"`{model}`", colmap.lens_case(model, binary), model in ("PINHOLE", "SIMPLE_RADIAL") and binary)
        yield case("`EQUIRECTANGULAR`, masks", colmap.sphere_case(binary, masks=True), binary)
        yield case(
            "gaps in numbers, ids out of order",
            colmap.sphere_case(binary, numbers=(0, 1, 4, 9), ids=[7, 70, 2, 5]),
            binary,
        )
        names = "Über uns ({}).png"
        yield case("names with spaces and umlauts", colmap.sphere_case(binary, name=names, masks=True), binary)
        yield case("numbers without leading zeros", colmap.sphere_case(binary, range(7, 12), "{}.png"), binary)
        equal = colmap.sphere_case(binary, cameras=colmap.equal_cameras, of_frame=lambda at: at % 2)
        yield case("two equal cameras", equal)
        yield case("cameras of all models that no image has", colmap.sphere_case(binary, cameras=colmap.unused_cameras))
        yield case("a rig of two cameras, `rigs` and `frames`", colmap.rig_case(binary), binary)
    yield Case(COLMAP, BINARY, "images of two different cameras", "colmap", colmap.two_lenses)
    yield Case(COLMAP, BINARY, "four of six images registered", "colmap", colmap.partly_registered)
    yield Case(COLMAP, "`sparse/0`, `sparse/1`, binary", "the second model is the larger", "colmap", colmap.several_models)
    for line in ("1 SPHERICAL 64 32 64 32", "1 SPHERE 64 32 1 32 16"):
        name = line.split()[1]
        yield Case("forks of COLMAP", TEXT, f"`{name}`", "colmap", colmap.fork(line))


def of_transforms():
    def nerfstudio(what, build, sent=False):
        return Case(NERFSTUDIO, TRANSFORMS, what, "nerfstudio", build, sent)

    yield nerfstudio("images, one camera, `sparse_pc.ply`", transforms.images_case("OPENCV"))
    yield nerfstudio("images, a camera with every frame", transforms.images_case("SIMPLE_RADIAL", per_frame=True))
    yield nerfstudio("images, `OPENCV_FISHEYE`", transforms.images_case("OPENCV_FISHEYE", fisheye=True))
    yield nerfstudio("images, one mask for all frames", transforms.camera_mask, True)
    yield nerfstudio("metashape, spherical", transforms.metashape_case(True), True)
    yield nerfstudio("metashape, spherical, without calibration", transforms.metashape_case(False))
    yield nerfstudio("metashape, frame camera", transforms.metashape_frames)
    yield nerfstudio("polycam", transforms.polycam)
    yield nerfstudio("record3d", transforms.record3d)
    for what, build in (
        ("`OPENCV`", transforms.instant_ngp_case("OPENCV")),
        ("`is_fisheye`", transforms.instant_ngp_case("OPENCV_FISHEYE", True)),
        ("fields of view alone", transforms.angles_alone),
    ):
        yield Case(NGP, TRANSFORMS, what, "nerfstudio", build)


def of_others():
    def openmvg(version, what, build):
        return Case(f"{OPENMVG} {version}", SFM_DATA, what, "openmvg", build)

    spheres = [others.sphere()] * 4
    of_view = {"of_view": lambda at: at}
    first = {"version": "0.1", "with_ids": False}
    yield openmvg("0.1 to 0.9", "spherical, views without `polymorphic_id`", others.openmvg_case(spheres[:1], **first))
    yield openmvg("1.x, 2.x", "spherical", others.openmvg_case(spheres[:1]))
    yield openmvg("1.x, 2.x", "an equal intrinsic for every view", others.openmvg_case(spheres, **of_view))
    yield openmvg("1.x, 2.x", "spherical, 64x30", others.openmvg_case([others.sphere((64, 30))]))
    yield openmvg("1.x, 2.x", "`pinhole`", others.openmvg_case([others.pinhole()], others.lens("SIMPLE_PINHOLE")))
    k1 = others.pinhole("pinhole_radial_k1", disto_k1=[-0.08])
    yield openmvg("1.x, 2.x", "`pinhole_radial_k1`", others.openmvg_case([k1], others.lens("SIMPLE_RADIAL", -0.08)))
    k3 = others.pinhole("pinhole_radial_k3", disto_k3=[-0.1, 0.02, 0.004])
    full = others.lens("FULL_OPENCV", -0.1, 0.02, 0.0, 0.0, 0.004, 0.0, 0.0, 0.0)
    yield openmvg("1.x, 2.x", "`pinhole_radial_k3`", others.openmvg_case([k3], full))
    k4 = others.pinhole("fisheye", fisheye=[-0.03, 0.01, -0.004, 0.0005])
    fisheye = others.lens("OPENCV_FISHEYE", -0.03, 0.01, -0.004, 0.0005)
    yield openmvg("1.x, 2.x", "`fisheye`", others.openmvg_case([k4], fisheye))
    apart = "`data_views.json`, `data_extrinsics.json`"
    yield Case("ODGS", apart, "no intrinsics, masks, lists of the split", "openmvg", others.odgs)
    panoramas = "`pano/`, `rotation.npy`, `translation.npy`"
    for what, build in (
        ("numbered from 0", others.hm3d_case()),
        ("numbered from 1, without leading zeros", others.hm3d_case(range(1, 12), "{}.png")),
        ("gaps in the numbers", others.hm3d_case((0, 1, 5))),
    ):
        yield Case("Splatter-360", panoramas, what, "hm3d", build)
    for what, build in (
        ("numbers from 0 without leading zeros, masks", others.frames_case(range(12), "{}.png")),
        ("gaps in numbers with leading zeros", others.frames_case((0, 3, 7), "{:04d}.png")),
        ("gaps in numbers without leading zeros", others.frames_case((3, 7, 12), "{}.png")),
    ):
        yield Case("ours", "`rgb/`, `mask/`, `poses.json`", what, "frames", build)


def cases():
    yield from of_colmap()
    yield from of_transforms()
    yield from of_others()


def escaped(cell):
    return re.sub(r"([|<>])", r"\\\1", cell)


def refused(line, folder):
    """A line of the program, without the place of the folder."""
    return f"refused: {line.replace(str(folder), 'FOLDER')}"


def imported(program, case, folder, out, wrong):
    """Makes the folder of a case, imports it, and says in a cell what came of it."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    scene = case.build(folder)
    refusal = program.import_(folder, case.format, out)
    if refusal is not None:
        return refused(refusal, folder), None
    try:
        error = scenes.compare(out, scene)
    except scenes.Wrong as fault:
        wrong.append(f"{case.program}, {case.file}, {case.what}: {fault}")
        return f"WRONG: {fault}", None
    return "exactly" if error is None else f"straightened ({error:.1f})", out


def returned(program, scene, folder, case, wrong):
    """Exports a scene to every format, and says in a cell for each what its readers see."""
    cells = []
    for format_ in returns.READERS:
        out = folder / format_
        refusal = program.export(scene, format_, out)
        if refusal is not None:
            cells.append(escaped(refused(refusal, out)))
            continue
        try:
            returns.compare(scene, out, format_)
            cells.append("exactly")
        except scenes.Wrong as fault:
            wrong.append(f"{case.program}, {case.what}, to {format_}: {fault}")
            cells.append(f"WRONG: {fault}")
    return cells


def make(program, folder):
    """The tables, and what is wrong in lines."""
    rows, back, wrong = {}, [], []
    for number, case in enumerate(cases()):
        place, out = folder / f"{number:03d}", folder / f"{number:03d}.scene"
        cell, scene = imported(program, case, place, out, wrong)
        rows.setdefault((case.program, case.what, escaped(cell)), []).append(case.file)
        if case.returns and scene is not None:
            cells = returned(program, scene, folder / f"{number:03d}.back", case, wrong)
            back.append(f"| {case.program}: {case.what} | " + " | ".join(cells) + " |\n")
    names = " | ".join(f"`{name}`" for name in returns.READERS)
    head = "| program | file | what | read |\n|---|---|---|---|\n"
    second = f"\n| scene of | {names} |\n|---|{'---|' * len(returns.READERS)}\n"
    lines = [f"| {program} | {' and '.join(files)} | {what} | {cell} |\n" for (program, what, cell), files in rows.items()]
    return head + "".join(lines) + second + "".join(back), wrong
