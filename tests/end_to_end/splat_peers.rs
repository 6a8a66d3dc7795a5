//! Files of Gaussians of ours beside other programs that write and read them.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_reconstruct::formats::exchange::SPLAT_FORMATS;
use omnilife_schemas::testing::skip;

use crate::support::{omnilife, scratch};

/// Turned Gaussians of several shapes, none of which viewers need changed, with `rest` harmonics: a PLY as 3DGS writes
/// it.
fn write_scene(path: &Path, rest: u16) {
    let rests: Vec<String> = (0..rest).map(|number| format!("f_rest_{number}")).collect();
    let mut properties = vec![
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2",
    ];
    properties.extend(rests.iter().map(String::as_str));
    properties.extend([
        "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ]);
    let count = 300_u16;
    let mut bytes = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n");
    for property in properties {
        bytes += &format!("property float {property}\n");
    }
    let mut bytes = (bytes + "end_header\n").into_bytes();
    for number in 0..count {
        let wave = |pace: f32| (pace * f32::from(number) + 0.3).sin();
        let mut row = vec![3.0 * wave(0.7), 2.0 * wave(1.3), 2.5 * wave(2.1)];
        row.extend([0.0; 3]);
        row.extend([wave(0.11), wave(0.23), wave(0.37)]);
        row.extend((0..rest).map(|number| 0.8 * wave(0.03 * f32::from(number + 1))));
        row.push(3.0 * wave(0.05));
        row.extend([-3.0 + 0.5 * wave(0.9), -3.2 + 0.4 * wave(1.7), -3.8]);
        row.extend([0.3 + wave(0.41), wave(0.53), wave(0.67), wave(0.83)]);
        bytes.extend(row.into_iter().flat_map(f32::to_le_bytes));
    }
    std::fs::write(path, bytes).unwrap();
}

/// Returns the scene, and its export in its own axes.
fn exported(folder: &Path) -> [PathBuf; 2] {
    let scene = folder.join("scene.ply");
    write_scene(&scene, 0);
    let splat = exported_as(SPLAT_FORMATS[0].name, &scene, &folder.join("asset"));
    [scene, splat]
}

/// The file in a format that a file of Gaussians is exported to in its own axes.
fn exported_as(format: &str, scene: &Path, out: &Path) -> PathBuf {
    omnilife([
        "reconstruct".as_ref(),
        "export".as_ref(),
        scene.as_os_str(),
        "--up".as_ref(),
        "0,-1,0".as_ref(),
        "--format".as_ref(),
        format.as_ref(),
        "--out".as_ref(),
        out.as_os_str(),
    ])
    .succeeded();
    let record = std::fs::read(out.join("asset.json")).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    let changes = record["changes"].as_object().unwrap().values();
    assert!(changes.into_iter().all(|count| count.as_u64() == Some(0)));
    out.join(record["levels"][0]["file"].as_str().unwrap())
}

/// Runs the reader; returns whether the other program is installed.
fn read_by(arguments: &[&Path]) -> bool {
    let python = std::env::var("OMNILIFE_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/read_splats.py");
    let Ok(read) = Command::new(python).arg(script).args(arguments).output() else {
        return false;
    };
    let notes = String::from_utf8_lossy(&read.stderr);
    match read.status.code() {
        Some(3) => false,
        code => {
            assert_eq!(code, Some(0), "{notes}");
            true
        }
    }
}

#[test]
fn rows_are_those_that_ply2splat_writes() {
    let folder = scratch();
    let [scene, splat] = exported(folder.path());
    if !read_by(&["ply2splat".as_ref(), &splat, &scene]) {
        skip("no Python with ply2splat; OMNILIFE_TEST_PYTHON names one that has it");
    }
}

#[test]
fn splat_transform_reads_what_was_written() {
    let Some(program) = std::env::var_os("OMNILIFE_TEST_SPLAT_TRANSFORM") else {
        skip(
            "OMNILIFE_TEST_SPLAT_TRANSFORM does not name splat-transform (npm, @playcanvas/splat-transform)",
        );
        return;
    };
    let folder = scratch();
    let [_, splat] = exported(folder.path());
    assert!(read_by(&[
        "splat-transform".as_ref(),
        &splat,
        program.as_ref()
    ]));
}

/// In formats that keep harmonics, of every degree.
#[test]
fn splat_transform_and_this_program_read_each_other() {
    let Some(program) = std::env::var_os("OMNILIFE_TEST_SPLAT_TRANSFORM") else {
        skip("OMNILIFE_TEST_SPLAT_TRANSFORM does not name splat-transform");
        return;
    };
    let folder = scratch();
    let convert = |from: &Path, to: &Path| {
        let ran = Command::new(&program)
            .args([Path::new("-w"), Path::new("-g"), Path::new("cpu"), from, to])
            .output();
        let ran = ran.unwrap();
        assert!(
            ran.status.success(),
            "{}",
            String::from_utf8_lossy(&ran.stderr)
        );
    };
    for rest in [0, 9, 24, 45] {
        let scene = folder.path().join(format!("scene-{rest}.ply"));
        write_scene(&scene, rest);
        for format in SPLAT_FORMATS
            .iter()
            .filter(|format| !format.is_for_old_viewers)
        {
            let asset = |name: &str| {
                let name = format!("{name}-{rest}-{}", format.name);
                folder.path().join(name)
            };
            let ours = exported_as(format.name, &scene, &asset("ours"));
            let is_sog = format.name == "sog";
            let degrees = if is_sog { "1.2" } else { "0.4" };
            let converted = folder.path().join("converted.ply");
            // It writes glTF, but reads none.
            if format.name != "glb" {
                convert(&ours, &converted);
                let files: [&Path; 4] = ["alike".as_ref(), &scene, &converted, degrees.as_ref()];
                assert!(read_by(&files));
            }
            let theirs = folder.path().join(format!("theirs{}", format.ending));
            convert(&scene, &theirs);
            let back = exported_as("ply", &theirs, &asset("theirs"));
            // Its palettes have fewer rows of harmonics than this scene: its own reading is the truth.
            if is_sog {
                convert(&theirs, &converted);
            }
            let truth = if is_sog { &converted } else { &scene };
            assert!(read_by(&["alike".as_ref(), truth, &back]));
        }
    }
}

/// SPZ with harmonics of degree 3, read by Spark, written again in version 2, and read.
#[test]
fn spark_reads_what_was_written() {
    let Some(modules) = std::env::var_os("OMNILIFE_TEST_SPARK") else {
        skip("OMNILIFE_TEST_SPARK does not name a node_modules with @sparkjsdev/spark and three");
        return;
    };
    let folder = scratch();
    let [scene, theirs] = ["scene.ply", "theirs.spz"].map(|name| folder.path().join(name));
    write_scene(&scene, 45);
    let ours = exported_as("spz-3", &scene, &folder.path().join("ours"));
    let script = "tests/end_to_end/spark_transcodes.mjs";
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join(script);
    let mut node = Command::new("node");
    node.arg(script).arg(modules).args([&ours, &theirs]);
    let ran = node.output().unwrap();
    assert!(
        ran.status.success(),
        "{}",
        String::from_utf8_lossy(&ran.stderr)
    );
    let back = exported_as("ply", &theirs, &folder.path().join("back"));
    // Version 2 leaves out the part w of a rotation; where that is small, it is lost.
    assert!(read_by(&["alike".as_ref(), &scene, &back, "12".as_ref()]));
}
