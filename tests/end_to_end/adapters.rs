//! Adapters of published methods, with a stand-in for the method: a program named `python` that leaves the right
//! images in the layout of that method's own code. If they reach the right frames, the scores are perfect.

use std::{fs, os::unix::fs::PermissionsExt, path::Path};

use omnilife_schemas::{
    records::{ExternalRun, ResultRecord},
    store,
};

use crate::support::{SEQUENCE, omnilife, scratch, small_run};

/// Layouts of the stand-ins: in `sh`, with `$frames` (folder of the right images), `$novel`, `$input`
/// and the group's members as lists of numbers, six digits each. `$W` is the work folder.
const IN_ORDER: &str = r#"
put() { mkdir -p "$W/model/$1/ours_$2/renders"; i=0; for f in $3; do
  cp "$frames/$f.png" "$W/model/$1/ours_$2/renders/$(printf %05d $i).png"; i=$((i+1)); done; }
put test ITERATIONS "$novel"; put train ITERATIONS "$input"
"#;
const BY_NAME: &str = r#"
for set in test train; do mkdir -p "$W/model/$set/iters_30000/renders"; done
for f in $novel; do cp "$frames/$f.png" "$W/model/test/iters_30000/renders/"; done
for f in $input; do cp "$frames/$f.png" "$W/model/train/iters_30000/renders/"; done
"#;
const BY_GROUP: &str = r#"
mkdir -p "$W/views/NAME000/color"
for f in $novel; do cp "$frames/$f.png" "$W/views/NAME000/color/"; done
"#;

const LAYOUTS: [(&str, &str, &str, &str, &str); 7] = [
    ("odgs", "per-scene", BY_NAME, "", ""),
    (
        "deformable-gs",
        "per-scene",
        IN_ORDER,
        "ITERATIONS",
        "40000",
    ),
    ("pvg", "per-scene", IN_ORDER, "ITERATIONS", "30000"),
    (
        "pansplat",
        "sparse-interpolation",
        BY_GROUP,
        "NAME",
        "omnilife/",
    ),
    (
        "splatter-360",
        "sparse-interpolation",
        BY_GROUP,
        "NAME",
        "omnilife/",
    ),
    (
        "omnisplat",
        "sparse-interpolation",
        BY_GROUP,
        "NAME",
        "omnilife/",
    ),
    ("panosplatt3r", "sparse-interpolation", BY_GROUP, "NAME", ""),
];

fn numbers(frames: &[u32]) -> String {
    let names: Vec<String> = frames.iter().map(|frame| format!("{frame:06}")).collect();
    names.join(" ")
}

/// Makes a virtual environment whose `python` runs our scripts with the real one, and leaves the views on any other
/// call.
fn stand_in(folder: &Path, body: &str) {
    let python = folder.join("bin/python");
    fs::create_dir_all(folder.join("bin")).unwrap();
    let script =
        format!("#!/bin/sh\ncase \"$1\" in *groups.py) exec python3 \"$@\";; esac\n{body}\n");
    fs::write(&python, script).unwrap();
    fs::set_permissions(&python, fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn views_in_the_layout_of_every_published_method_reach_their_frames() {
    let scene = small_run().out.join(SEQUENCE);
    let folder = scratch();
    for (id, protocol, layout, from, to) in LAYOUTS {
        let place = folder.path().join(id);
        let at = |name: &str| place.join(name);
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        let code = text(&at("code"));
        omnilife(["bench", "adapter", id, "--out", &code]).succeeded();
        let split_file = text(&at("split.json"));
        let scene_file = text(&scene.join("scene.json"));
        let split = [
            "bench",
            "split",
            &scene_file,
            "--protocol",
            protocol,
            "--out",
            &split_file,
        ];
        omnilife(split).succeeded();
        let split: omnilife_schemas::records::Split =
            store::read_record(Path::new(&split_file)).unwrap();
        let run = text(&at("run"));
        let head = format!(
            "W=\"{run}/work\"\nframes=\"{}\"\nnovel=\"{}\"\ninput=\"{}\"\n",
            text(&scene.join("frames")),
            numbers(&split.novel_views),
            numbers(&split.input_views)
        );
        let layout = if from.is_empty() {
            layout.to_owned()
        } else {
            layout.replace(from, to)
        };
        stand_in(&at("python"), &(head + &layout));
        // The same manifest in another environment, without conda.
        let manifest = at("code").join("method.toml");
        let adapted = fs::read_to_string(&manifest).unwrap();
        let name = adapted.find("kind = \"conda\"\nname = ").unwrap();
        let end = name + adapted[name..].find("\n\n").unwrap();
        let environment = format!("kind = \"venv\"\npath = \"{}\"", text(&at("python")));
        fs::write(
            &manifest,
            format!("{}{environment}{}", &adapted[..name], &adapted[end..]),
        )
        .unwrap();
        let method = text(&manifest);
        omnilife([
            "--quiet",
            "bench",
            "external",
            &method,
            "--scene",
            &scene_file,
            "--split",
            &split_file,
            "--out",
            &run,
        ])
        .succeeded();
        let record: ExternalRun = store::read_record(&at("run/external-run.json")).unwrap();
        assert_eq!(record.failure, None, "{id}");
        let (run, scores) = (format!("{run}/external-run.json"), text(&at("scores")));
        omnilife([
            "--quiet",
            "bench",
            "score",
            "--scene",
            &scene_file,
            "--split",
            &split_file,
            "--run",
            &run,
            "--out",
            &scores,
        ])
        .succeeded();
        let result: ResultRecord = store::read_record(&at("scores/result.json")).unwrap();
        assert!(result.failures.is_empty(), "{id}: {:?}", result.failures);
        assert_eq!(result.novel_views["psnr"].mean, 100.0, "{id}");
        let inputs = result.input_views.get("psnr").map(|summary| summary.mean);
        let expected = (protocol == "per-scene").then_some(100.0);
        assert_eq!(inputs, expected, "{id}");
    }
}
