//! Our `.splat` files beside other programs that write and read them.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use omnilife_schemas::testing::skip;

use crate::support::{omnilife, scratch};

/// Writes rotated Gaussians of several shapes, which viewers show unchanged, to a PLY as 3DGS writes it.
fn write_scene(path: &Path) {
    let properties = [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0",
        "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ];
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
        row.push(3.0 * wave(0.05));
        row.extend([-3.0 + 0.5 * wave(0.9), -3.2 + 0.4 * wave(1.7), -3.8]);
        row.extend([0.3 + wave(0.41), wave(0.53), wave(0.67), wave(0.83)]);
        bytes.extend(row.into_iter().flat_map(f32::to_le_bytes));
    }
    std::fs::write(path, bytes).unwrap();
}

/// Returns the scene, and its export in its own axes.
fn exported(folder: &Path) -> [PathBuf; 2] {
    let (scene, out) = (folder.join("scene.ply"), folder.join("asset"));
    write_scene(&scene);
    omnilife([
        "reconstruct".as_ref(),
        "export".as_ref(),
        scene.as_os_str(),
        "--up".as_ref(),
        "0,-1,0".as_ref(),
        "--out".as_ref(),
        out.as_os_str(),
    ])
    .succeeded();
    let record = std::fs::read(out.join("asset.json")).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    let changes = record["changes"].as_object().unwrap().values();
    assert!(changes.into_iter().all(|count| count.as_u64() == Some(0)));
    [scene, out.join("full.splat")]
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
