//! Comparison with perspective trainers (`scripts/compare splatters`), with a stand-in for a trainer that returns
//! Gaussians of ours: faces out, Gaussians in, panoramas from faces, scores.

use std::{ffi::OsStr, fs, os::unix::fs::PermissionsExt, path::Path, process::Command};

use omnilife_schemas::{records::ResultRecord, store, testing::skip};

use crate::support::{METHOD, SEQUENCE, omnilife, scratch, small_run};

#[test]
fn gaussians_that_come_back_score_as_where_they_come_from() {
    if Command::new("python3").arg("--version").output().is_err() {
        skip("there is no python3");
        return;
    }
    let run = &small_run().out;
    let folder = scratch();
    let trainer = folder.path().join("trainer");
    // Without aids: points of their spacing's size shrink with the pixels of a face, and the scores of faces and
    // panoramas part.
    let split = run.join(METHOD).join("../split.json");
    let trained = folder.path().join("trained");
    let scored = folder.path().join("scored");
    let scene = run.join(SEQUENCE).join("scene.json");
    for words in [
        format!(
            "reconstruct train {} --split {} --without aids --iterations 30 --out {}",
            scene.display(),
            split.display(),
            trained.display()
        ),
        format!(
            "bench score --scene {} --split {} --run {} --out {}",
            scene.display(),
            split.display(),
            trained.display(),
            scored.display()
        ),
    ] {
        omnilife(words.split(' ').map(OsStr::new)).succeeded();
    }
    // $1 is the project, $5 the file to leave.
    let script = format!(
        "#!/bin/sh\ntest -f \"$1/sparse/0/images.bin\" && test -f \"$1/images/up/000000.png\" && \
         test ! -f \"$1/images/up/000004.png\" && cp '{}' \"$5\"\n",
        trained.join("gaussians.ply").display()
    );
    fs::write(&trainer, script).unwrap();
    fs::set_permissions(&trainer, fs::Permissions::from_mode(0o755)).unwrap();
    let ended = Command::new(Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/compare"))
        .args([
            "splatters".as_ref(),
            "--program".as_ref(),
            trainer.as_os_str(),
        ])
        .arg(run.join(SEQUENCE))
        .arg(&split)
        .arg(folder.path().join("out"))
        .arg("10")
        .env("OMNILIFE", env!("CARGO_BIN_EXE_omnilife"))
        .output()
        .unwrap();
    let (table, notes) = (
        String::from_utf8_lossy(&ended.stdout),
        String::from_utf8_lossy(&ended.stderr),
    );
    assert!(ended.status.success(), "{table}{notes}");
    let of = |name: &str| -> f64 {
        let row = table.lines().find(|line| line.contains(name));
        let cells: Vec<&str> = row.unwrap_or_default().split('|').collect();
        cells
            .get(4)
            .and_then(|cell| cell.trim().parse().ok())
            .expect(&table)
    };
    let own: ResultRecord = store::read_record(&scored.join("result.json")).unwrap();
    let own = own.novel_views["psnr"].mean;
    let returned = of("trainer, 10 iterations");
    assert!((returned - own).abs() < 1.0, "{returned} {own}\n{table}");
    assert!(of("odgs") > 0.0 && of("omni4dgs-plus") > 0.0);
}
