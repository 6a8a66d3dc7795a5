//! Gaussians of a run exported for web viewers, rendered again, and shown in a browser.

use std::{
    ffi::OsStr,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

use omnilife_reconstruct::formats::exchange::SPLAT_FORMATS;
use serde_json::Value;

use crate::support::{METHOD, SEQUENCE, kept_folder, omnilife, read_image, scratch, small_run};

fn exported(out: &Path, arguments: &[&str]) -> crate::support::Ended {
    let run = small_run().out.join(METHOD).join("run");
    let mut words = vec!["reconstruct", "export", run.to_str().unwrap(), "--out"];
    words.push(out.to_str().unwrap());
    words.extend(arguments);
    omnilife(words)
}

pub(crate) fn asset(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("asset.json")).unwrap()).unwrap()
}

#[test]
fn levels_are_exported_with_a_record_and_rendered_again() {
    let folder = scratch();
    let out = folder.path().join("asset");
    let ended = exported(&out, &["--lod", "100,50,9M,full"]).succeeded();
    assert!(
        ended.stderr.contains("level 9M is left out"),
        "{}",
        ended.stderr
    );
    let record = asset(&out);
    let levels = record["levels"].as_array().unwrap();
    let names: Vec<&str> = levels
        .iter()
        .map(|level| level["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["50", "100", "full"]);
    for level in levels {
        let file = out.join(level["file"].as_str().unwrap());
        let bytes = std::fs::metadata(file).unwrap().len();
        assert_eq!(Some(bytes), level["bytes"].as_u64());
        assert_eq!(
            Some(bytes),
            level["splats"].as_u64().map(|splats| 32 * splats)
        );
    }
    // Bytes of colours and rotations, thickened needles, the shell pulled in: the same place still.
    let decibels = decibels_of_view(&out.join("full.splat"), folder.path());
    assert!(decibels > 25.0, "{decibels}");
}

/// PSNR between a view of a file of the small run and that of the run.
fn decibels_of_view(file: &Path, folder: &Path) -> f64 {
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let views = folder
        .join("views")
        .with_extension(file.extension().unwrap());
    omnilife([
        "reconstruct".as_ref(),
        "render".as_ref(),
        file.as_os_str(),
        "--poses".as_ref(),
        scene.as_os_str(),
        "--out".as_ref(),
        views.as_os_str(),
    ])
    .succeeded();
    let run = small_run().out.join(METHOD).join("run");
    let predicted = read_image(&run.join("predictions/novel/000004.png"));
    let rendered = read_image(&views.join("000004.png"));
    let squares = predicted
        .iter()
        .zip(rendered.iter())
        .map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    let mean = squares.sum::<f64>() / predicted.len() as f64;
    10.0 * (255.0 * 255.0 / mean).log10()
}

#[test]
fn levels_of_every_format_are_rendered_as_the_run_is() {
    let folder = scratch();
    for format in SPLAT_FORMATS
        .iter()
        .filter(|format| !format.is_for_old_viewers)
    {
        let out = folder.path().join(format.name);
        exported(&out, &["--lod", "100,full", "--format", format.name]).succeeded();
        let record = asset(&out);
        let levels = record["levels"].as_array().unwrap();
        assert_eq!(levels.len(), 2);
        for level in levels {
            let file = level["file"].as_str().unwrap();
            assert!(file.ends_with(format.ending), "{file}");
            let bytes = std::fs::metadata(out.join(file)).unwrap().len();
            assert_eq!(Some(bytes), level["bytes"].as_u64());
        }
        assert_eq!(levels[0]["splats"], 100);
        let full = out.join(format!("full{}", format.ending));
        let decibels = decibels_of_view(&full, &out);
        assert!(decibels > 25.0, "{}: {decibels}", format.name);
    }
}

#[test]
fn requests_that_make_no_asset_are_refused_in_one_line_and_leave_nothing() {
    let folder = scratch();
    let out = folder.path().join("asset");
    for (arguments, expected) in [
        (
            &["--lod", "9M"][..],
            "fewer than every level that is asked for; ask for full",
        ),
        (&["--up", "0,0,0"], "--up must be a direction"),
        (&["--format", "spz", "--page"], "a page holds .splat levels"),
        (&["--format", "spx"], "did you mean \"spz\"?"),
    ] {
        let ended = exported(&out, arguments);
        let line = ended.failed_quietly(2);
        assert!(line.contains(expected), "{line}");
        assert!(!out.exists());
    }
    let ended = exported(&out, &["--lod", "some"]);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("a level must be"), "{}", ended.stderr);
    let broken = folder.path().join("broken.splat");
    std::fs::write(&broken, [0; 33]).unwrap();
    let ended = omnilife([
        "reconstruct".as_ref(),
        "export".as_ref(),
        broken.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
    ]);
    assert!(
        ended
            .failed_quietly(2)
            .contains("broken.splat: must have whole rows of 32 bytes, got 33"),
        "{}",
        ended.stderr
    );
}

#[test]
fn without_the_viewer_the_page_is_a_line_and_the_levels_are_there() {
    let folder = scratch();
    let out = folder.path().join("asset");
    let run = small_run().out.join(METHOD).join("run");
    let ended = Command::new(env!("CARGO_BIN_EXE_omnilife"))
        .args(["reconstruct", "export"])
        .arg(&run)
        .args(["--page", "--out"])
        .arg(&out)
        .env("OMNILIFE_DATA", folder.path())
        .output()
        .unwrap();
    assert!(ended.status.success());
    let stderr = String::from_utf8_lossy(&ended.stderr);
    assert!(stderr.contains("scripts/setup --viewer"), "{stderr}");
    assert!(out.join("full.splat").exists() && !out.join("index.html").exists());
    assert!(asset(&out)["page"].is_null());
}

/// Writes a wall of opaque Gaussians in front of the origin, with a dark letter F on colours that change along it. It
/// differs from its mirror image and upside down.
fn write_poster(path: &Path) {
    let properties = [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0",
        "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ];
    let (columns, rows) = (80_i32, 60_i32);
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        columns * rows
    );
    for property in properties {
        bytes += &format!("property float {property}\n");
    }
    let mut bytes = (bytes + "end_header\n").into_bytes();
    for row in 0..rows {
        for column in 0..columns {
            let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
            let is_letter = (0.35..0.45).contains(&u) && (0.2..0.8).contains(&v)
                || (0.35..0.7).contains(&u)
                    && ((0.2..0.32).contains(&v) || (0.45..0.55).contains(&v));
            let colour = if is_letter {
                [0.3, 0.05, 0.05]
            } else {
                [0.3 + 0.3 * v, 0.4 + 0.5 * u, 0.5 + 0.4 * u]
            };
            let colour = colour.map(|value| (value - 0.5) / 0.282_094_8);
            let mut values = vec![8.0 * (u - 0.5), 6.0 * (v - 0.5), 3.0, 0.0, 0.0, 0.0];
            values.extend(colour);
            values.push(4.0);
            values.extend([0.07_f32.ln(); 3]);
            values.extend([1.0, 0.0, 0.0, 0.0]);
            bytes.extend(values.into_iter().flat_map(f32::to_le_bytes));
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// Returns why pages cannot be shown here.
pub(crate) fn no_browser() -> Option<&'static str> {
    let found = |program: &str| Command::new(program).arg("--version").output().is_ok();
    let all = found("chromium") && found("chromedriver") && found("python3");
    (!all).then_some("no Chromium with its driver, scripts/setup --browser installs them")
}

/// Returns the renderer's image of the first view of an asset's page: from the origin of the files along their z, 75
/// degrees high at 640 x 480; a PPM.
fn view_of_page(folder: &Path, out: &Path, record: &Value) -> PathBuf {
    let placement = &record["placement"];
    let [w, x, y, z] = [0, 1, 2, 3].map(|at| placement["rotation_wxyz"][at].as_f64().unwrap());
    let poses = serde_json::json!({
        "schema": "omnilife/poses/2",
        "scale": "arbitrary",
        "camera": null,
        "frames": [{
            "time_seconds": 0.0,
            "pose": { "rotation_wxyz": [w, -x, -y, -z], "centre": placement["offset"] },
            "mask": null,
        }],
        "points": null,
    });
    let path = folder.join("poses.json");
    std::fs::write(&path, poses.to_string()).unwrap();
    let views = folder.join("views");
    let degrees = 2.0
        * (37.5_f64.to_radians().tan() * 640.0 / 480.0)
            .atan()
            .to_degrees();
    omnilife([
        "reconstruct".as_ref(),
        "render".as_ref(),
        out.join("full.splat").as_os_str(),
        "--poses".as_ref(),
        path.as_os_str(),
        "--camera".as_ref(),
        "pinhole".as_ref(),
        "--size".as_ref(),
        "640x480".as_ref(),
        "--fov-degrees".as_ref(),
        degrees.to_string().as_ref(),
        "--out".as_ref(),
        views.as_os_str(),
    ])
    .succeeded();
    let mut view = b"P6 640 480 255\n".to_vec();
    view.extend(read_image(&views.join("000000.png")).iter());
    let ppm = folder.join("view.ppm");
    std::fs::write(&ppm, view).unwrap();
    ppm
}

/// Compares a page with a view of it in headless Chromium.
fn look_at_page(out: &Path, view: &Path, arguments: [&str; 2], screenshot: &str) {
    let mut browser = Command::new("python3");
    browser
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/asset_in_browser.py"))
        .arg(out.join("index.html"))
        .arg(view)
        .args(arguments);
    if let Some(folder) = std::env::var_os("OMNILIFE_SCREENSHOTS") {
        let file = Path::new(&folder).join(screenshot);
        browser.arg("--screenshot").arg(file);
    }
    let output = browser.output().unwrap();
    print!("{}", String::from_utf8_lossy(&output.stdout));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
}

/// Exports an asset of the poster.
fn exported_poster(folder: &Path, arguments: &[&str]) -> PathBuf {
    let (poster, out) = (folder.join("poster.ply"), folder.join("asset"));
    write_poster(&poster);
    let made = Command::new(env!("CARGO_BIN_EXE_omnilife"))
        .args(["reconstruct", "export", "--up", "0,-1,0"])
        .args(arguments)
        .arg(poster)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    assert!(made.status.success());
    out
}

#[test]
fn the_page_shows_in_a_browser_what_the_renderer_draws() {
    if let Some(reason) = no_browser() {
        omnilife_schemas::testing::skip(reason);
        return;
    }
    let folder = scratch();
    let out = exported_poster(folder.path(), &["--page"]);
    let record = asset(&out);
    if record["page"].is_null() {
        omnilife_schemas::testing::skip("no viewer, scripts/setup --viewer fetches it");
        return;
    }
    let view = view_of_page(folder.path(), &out, &record);
    let splats = record["splats"].to_string();
    look_at_page(&out, &view, ["--splats", &splats], "asset.png");
}

#[test]
fn other_viewers_show_what_the_renderer_draws() {
    let Some(modules) = std::env::var_os("OMNILIFE_TEST_VIEWERS") else {
        omnilife_schemas::testing::skip(
            "OMNILIFE_TEST_VIEWERS does not name a node_modules with @mkkellogg/gaussian-splats-3d, three and gsplat",
        );
        return;
    };
    if let Some(reason) = no_browser() {
        omnilife_schemas::testing::skip(reason);
        return;
    }
    let folder = scratch();
    let out = exported_poster(folder.path(), &[]);
    let view = view_of_page(folder.path(), &out, &asset(&out));
    for viewer in ["gaussian-splats-3d", "gsplat"] {
        let output = Command::new("python3")
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/splat_in_viewers.py"))
            .arg(viewer)
            .arg(&modules)
            .arg(out.join("full.splat"))
            .arg(&view)
            .output()
            .unwrap();
        print!("{}", String::from_utf8_lossy(&output.stdout));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{viewer}: {stderr}");
    }
}

/// Run of a method with moving Gaussians on the small scene.
static MOVING_RUN: LazyLock<PathBuf> = LazyLock::new(|| {
    let sequence = small_run().out.join(SEQUENCE);
    let (scene, split) = (
        sequence.join("scene.json"),
        sequence.join("per-scene/split.json"),
    );
    let run = kept_folder(Path::new(env!("CARGO_TARGET_TMPDIR"))).join("run");
    let mut arguments = vec!["reconstruct".as_ref(), "train".as_ref(), scene.as_os_str()];
    arguments.extend(["--split".as_ref(), split.as_os_str()]);
    arguments.extend(["--out".as_ref(), run.as_os_str()]);
    let settings = ["--method", "omni4dgs", "--iterations", "60"];
    arguments.extend(settings.map(OsStr::new));
    omnilife(arguments).succeeded();
    run
});

/// Returns the run with moving Gaussians, which several tests read.
pub(crate) fn moving_run() -> &'static Path {
    &MOVING_RUN
}

#[test]
fn a_scene_that_moves_is_exported_at_moments_and_its_page_has_a_slider() {
    let folder = scratch();
    let run = moving_run();
    let out = folder.path().join("asset");
    // With the data folder of this machine, where the viewer is.
    let export = |arguments: &[&str]| {
        let ended = Command::new(env!("CARGO_BIN_EXE_omnilife"))
            .args(["reconstruct", "export"])
            .arg(run)
            .arg("--out")
            .arg(&out)
            .args(arguments)
            .output()
            .unwrap();
        assert!(ended.status.success());
        asset(&out)
    };
    let record = export(&["--moments", "5", "--page"]);
    let moments = record["moments"]["moments"].as_array().unwrap();
    assert_eq!(moments.len(), 5);
    // From the scene's first frame to its last; levels show the middle.
    let seconds = |moment: &Value| moment["time_seconds"].as_f64().unwrap();
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let scene: Value = serde_json::from_slice(&std::fs::read(scene).unwrap()).unwrap();
    let frames = scene["frames"].as_array().unwrap();
    for (moment, frame) in [
        (&moments[0], &frames[0]),
        (&moments[4], &frames[frames.len() - 1]),
    ] {
        assert!((seconds(moment) - seconds(frame)).abs() < 1e-3);
    }
    let shown = record["source"]["time_seconds"].as_f64().unwrap();
    assert!((seconds(&moments[2]) - shown).abs() < 1e-9);
    let splats = |file: &Value| {
        let count = file["splats"].as_u64().unwrap();
        let path = out.join(file["file"].as_str().unwrap());
        assert_eq!(std::fs::metadata(path).unwrap().len(), 32 * count);
        count
    };
    let still = splats(&record["moments"]["still"]);
    let moving = moments.iter().map(|moment| splats(&moment["moving"]));
    let moving: Vec<u64> = moving.collect();
    assert!(
        still > 0 && moving.iter().all(|&moving| moving > 0),
        "{moving:?}"
    );
    // The level shows everything that is static or moving at the middle, except Gaussians that are about to become
    // visible.
    let level = record["levels"][0]["splats"].as_u64().unwrap();
    assert!((still + moving[2]).abs_diff(level) <= level / 100);
    if let (None, false) = (no_browser(), record["page"].is_null()) {
        assert_eq!(record["page"]["holds_moments"], true);
        let view = view_of_page(folder.path(), &out, &record);
        look_at_page(&out, &view, ["--moments", "5"], "moving-asset.png");
    } else {
        omnilife_schemas::testing::skip("no Chromium, or no viewer, to look at moments with");
    }
    // Leftovers of another export are removed.
    let record = export(&["--moments", "1"]);
    assert!(record.get("moments").is_none() && !out.join("still.splat").exists());
}
