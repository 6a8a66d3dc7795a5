//! Curation from videos to a published dataset (`omnilife curate`): checked, broken, killed and made again.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::support::{Ended, copy_of_small_run, files, footage, omnilife, sample, scratch};

const SMALL: [&str; 4] = ["--max-frames", "6", "--width", "128"];

/// Runs `omnilife curate` on videos, with slices.
fn curate(videos: &[&Path], out: &Path, further: &[&str]) -> Ended {
    omnilife(words(videos, out, further))
}

fn words(videos: &[&Path], out: &Path, further: &[&str]) -> Vec<String> {
    let mut words = vec!["curate".to_owned()];
    words.extend(videos.iter().map(|video| video.display().to_string()));
    words.extend(["--out".to_owned(), out.display().to_string()]);
    words.extend(SMALL.iter().chain(further).map(|&word| word.to_owned()));
    words
}

fn verify(dataset: &Path) -> Ended {
    omnilife(["curate", "verify", dataset.to_str().unwrap(), "--quiet"])
}

/// Returns every published file with its content.
fn published(dataset: &Path) -> BTreeMap<String, Vec<u8>> {
    files(dataset)
        .into_iter()
        .filter(|file| !file.split('/').any(|part| part.starts_with('.')))
        .map(|file| {
            let content = fs::read(dataset.join(&file)).unwrap();
            (file, content)
        })
        .collect()
}

#[test]
fn status_and_page_say_what_is_missing_and_the_command() {
    let folder = copy_of_small_run();
    let out = folder.path().to_str().unwrap();
    let said = omnilife(["curate", "status", out]).succeeded().stdout;
    assert!(said.contains("\nstreet/seq-000 "), "{said}");
    let command = format!("  omnilife curate annotate {out} --tags TAGS\n");
    assert!(said.contains(&command), "{said}");
    assert!(!said.contains("\nposes missing"), "{said}");
    let json = omnilife(["curate", "status", out, "--json"]);
    let json = json.succeeded().stdout;
    assert!(json.contains("omnilife curate annotate . --tags"), "{json}");

    omnilife(["curate", "overview", out]).succeeded();
    // The page and its record name commands of this machine: a release lists neither.
    let published = omnilife(["curate", "publish", out]).succeeded();
    let checksums = fs::read_to_string(folder.path().join("SHA256SUMS")).unwrap();
    assert!(checksums.contains("  dataset.json\n"), "{checksums}");
    for file in ["index.html", "status.json"] {
        assert!(!checksums.contains(&format!("  {file}\n")), "{file}");
        assert!(published.stderr.contains(file), "{}", published.stderr);
    }
    let record = fs::read_to_string(folder.path().join("status.json")).unwrap();
    assert_eq!(record, json);
    let page = fs::read_to_string(folder.path().join("index.html")).unwrap();
    assert!(page.contains("id=\"sequence-0\"") && page.contains("Camera path"));

    let nowhere = folder.path().join("nowhere");
    let ended = omnilife(["curate", "status", nowhere.to_str().unwrap()]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("nowhere: must be the folder"), "{message}");
}

#[test]
fn a_curated_dataset_is_sound_until_something_changes() {
    let folder = scratch();
    let out = folder.path().join("set");
    let ended = curate(
        &[&sample("street.mp4")],
        &out,
        &["--criteria", "none", "--slices"],
    );
    ended.succeeded();
    assert_eq!(
        verify(&out).succeeded().stdout,
        format!("{}: sound\n", out.display())
    );
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(card.contains("1 sequence from 1 of 1 video"), "{card}");
    let summary = fs::read_to_string(out.join("statistics/summary.csv")).unwrap();
    assert!(summary.contains("mean duration,2.0,seconds"), "{summary}");
    let sums = Command::new("sha256sum")
        .args(["--check", "--quiet", "SHA256SUMS"])
        .current_dir(&out)
        .status()
        .unwrap();
    assert!(sums.success(), "sha256sum reads the checksums");

    let sequence = "videos/street/seq-000/sequence.json";
    let frame = "videos/street/seq-000/frames/000002.png";
    let slices = "videos/street/slices.json";
    let healthy = published(&out);
    let faults_after = |change: &dyn Fn(&Path)| -> Vec<String> {
        change(&out);
        let ended = verify(&out);
        assert_eq!(ended.code, Some(2), "{}", ended.stderr);
        for (file, content) in &healthy {
            fs::write(out.join(file), content).unwrap();
        }
        drop(fs::remove_file(out.join("extra.txt")));
        ended.stdout.lines().map(str::to_owned).collect()
    };
    let edit = |file: &str, from: &str, to: &str| {
        let text = String::from_utf8(healthy[file].clone()).unwrap();
        assert!(text.contains(from), "{file} has no {from}");
        fs::write(out.join(file), text.replacen(from, to, 1)).unwrap();
    };
    let one = |faults: Vec<String>, part: &str| {
        assert!(
            faults.iter().any(|line| line.contains(part)),
            "{part}: {faults:?}"
        );
    };
    one(
        faults_after(&|out| fs::write(out.join("extra.txt"), "x").unwrap()),
        "extra.txt: is not in",
    );
    let missing = faults_after(&|out| fs::remove_file(out.join(frame)).unwrap());
    assert!(
        missing.iter().all(|line| line.contains("is missing")),
        "{missing:?}"
    );
    one(missing, frame);
    one(
        faults_after(&|out| fs::write(out.join(frame), "x").unwrap()),
        "has changed",
    );
    let broken = faults_after(&|_| edit(sequence, "\"range\"", "\"rnage\""));
    one(broken, "missing field `range`");
    let gap = faults_after(&|_| edit(slices, "\"begin_seconds\": 0.0", "\"begin_seconds\": 0.5"));
    one(gap, "does not follow");
    let funnel = faults_after(&|_| edit("funnel.csv", "kept,0,0.0,1,2.0", "kept,0,0.0,1,1.5"));
    one(funnel, "kept does not leave");
    let stale = faults_after(&|out| {
        edit("about.json", "\"set\"", "\"other\"");
        omnilife(["curate", "verify", out.to_str().unwrap()]);
    });
    one(stale, "about.json: has changed");
    verify(&out).succeeded();

    // Its description is kept.
    let text = out.to_str().unwrap();
    omnilife(format!("curate publish {text} --name Streets --licence CC-BY-4.0").split(' '))
        .succeeded();
    omnilife(["curate", "publish", text]).succeeded();
    verify(&out).succeeded();
    let card = fs::read_to_string(out.join("README.md")).unwrap();
    assert!(
        card.contains("# Streets\n") && card.contains("license: cc-by-4.0"),
        "{card}"
    );
}

#[test]
fn the_papers_criteria_keep_the_sample_out_and_say_why() {
    let folder = scratch();
    let out = folder.path().join("set");
    let ended = curate(&[&sample("street.mp4")], &out, &["--quiet"]);
    let message = ended.failed_quietly(2);
    assert!(message.contains("rejected"), "{message}");
    assert!(
        message.contains("512") && message.contains("3840"),
        "value and limit: {message}"
    );
    verify(&out).succeeded();
    assert!(
        fs::read_to_string(out.join("README.md"))
            .unwrap()
            .contains("0 sequences from 0 of 1")
    );
}

#[test]
fn killed_at_any_moment_it_ends_as_if_it_had_not_been() {
    let folder = scratch();
    let videos = [folder.path().join("a.mp4"), folder.path().join("b.mp4")];
    let content = fs::read(sample("street.mp4")).unwrap();
    fs::write(&videos[0], &content).unwrap();
    // Another file with the same images: a free box after the end changes no frame.
    fs::write(&videos[1], [&content[..], b"\0\0\0\x08free"].concat()).unwrap();
    let videos: Vec<&Path> = videos.iter().map(std::path::PathBuf::as_path).collect();
    let settings = ["--criteria", "none", "--slices", "--quiet"];
    let whole = folder.path().join("whole/set");
    let started = Instant::now();
    curate(&videos, &whole, &settings).succeeded();
    let takes = started.elapsed();
    let expected = published(&whole);
    assert!(
        expected
            .keys()
            .any(|file| file.ends_with("slices/seq-000.mp4"))
    );

    let out = folder.path().join("killed/set");
    let mut killed = 0;
    // Spread over the whole run, unevenly, and more than once into the same folder.
    for share in [0.03, 0.31, 0.52, 0.17, 0.68, 0.44, 0.83] {
        let mut child = Command::new(assert_cmd::cargo::cargo_bin!("omnilife"))
            .args(words(&videos, &out, &settings))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        thread::sleep(Duration::from_secs_f64(takes.as_secs_f64() * share));
        killed += usize::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
        if share > 0.6 {
            curate(&videos, &out, &settings).succeeded();
            let found = published(&out);
            assert_eq!(
                found.keys().collect::<Vec<_>>(),
                expected.keys().collect::<Vec<_>>(),
                "after a kill at {share} of {takes:?}"
            );
            for (file, content) in &expected {
                assert!(
                    found[file] == *content,
                    "{file} differs after a kill at {share}"
                );
            }
            verify(&out).succeeded();
            assert!(
                files(&out).iter().all(|file| !file.contains(".tmp-")),
                "{:?}",
                files(&out)
            );
            fs::remove_dir_all(&out).unwrap();
        }
    }
    assert!(killed > 0, "every run ended before it could be killed");
}

#[test]
fn a_scene_goes_to_another_tool_and_comes_back() {
    let run = copy_of_small_run();
    let scene = run.path().join("videos/street/seq-000");
    let scene = scene.to_str().unwrap();
    let there = run.path().join("there");
    let there = there.to_str().unwrap();
    let back = run.path().join("back");
    let export = [
        "curate", "export", scene, "--format", "openmvg", "--out", there,
    ];
    assert!(omnilife(export).succeeded().stdout.contains("10 frames"));
    let import = ["curate", "import", there, "--format", "openmvg", "--out"];
    let ended = omnilife(import.iter().copied().chain([back.to_str().unwrap()])).succeeded();
    assert_eq!(ended.stdout, "there: 10 of 10 frames posed\n");
    let again = omnilife(export);
    assert!(again.stderr.contains("is not empty"), "{}", again.stderr);
}

/// Novel views must not become training views because an export does not mark them.
#[test]
fn the_split_goes_into_every_export() {
    let run = copy_of_small_run();
    let scene = run.path().join("videos/street/seq-000");
    let (scene, split) = (
        scene.to_str().unwrap(),
        scene
            .join("per-scene/split.json")
            .to_str()
            .unwrap()
            .to_owned(),
    );
    let export = |format: &str, with_split: bool| {
        let out = run.path().join(format!("{format}-{with_split}"));
        let mut words = vec!["curate", "export", scene, "--format", format, "--out"];
        words.push(out.to_str().unwrap());
        words.extend(with_split.then_some(["--split", &split]).iter().flatten());
        let ended = omnilife(words).succeeded();
        assert_eq!(ended.stderr.contains("no split is given"), !with_split);
        out
    };
    let nerfstudio = export("nerfstudio", true).join("transforms.json");
    let transforms: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(nerfstudio).unwrap()).unwrap();
    let files = |key: &str| transforms[key].as_array().map_or(0, Vec::len);
    assert_eq!(
        ["train_filenames", "val_filenames", "test_filenames"].map(files),
        [8, 2, 2]
    );
    assert_eq!(transforms["test_filenames"][0], "images/000004.png");
    for format in ["colmap", "colmap-binary", "openmvg", "hm3d", "frames"] {
        let out = export(format, true);
        let lines = |name: &str| fs::read_to_string(out.join(name)).unwrap().lines().count();
        assert_eq!([lines("train.txt"), lines("test.txt")], [8, 2], "{format}");
    }
    assert!(!export("colmap", false).join("train.txt").exists());
}

/// COLMAP writes numbered folders of binary models.
#[test]
fn poses_are_read_from_the_folder_of_a_colmap_project() {
    let run = copy_of_small_run();
    let scene = run.path().join("videos/street/seq-000");
    let project = run.path().join("project");
    let [sequence, out] = [&scene, &project].map(|path| path.to_str().unwrap());
    let words = [
        "curate",
        "export",
        sequence,
        "--format",
        "colmap-binary",
        "--out",
        out,
    ];
    omnilife(words).succeeded();
    assert!(project.join("sparse/0/images.bin").is_file());
    let ended = omnilife(["curate", "poses", sequence, "--poses", out]).succeeded();
    assert!(
        ended.stdout.contains("10 of 10 frames posed"),
        "{}",
        ended.stdout
    );
}

#[test]
fn one_segment_of_a_video_is_cut_out() {
    let folder = scratch();
    let out = folder.path().join("cut.mp4");
    let out = out.to_str().unwrap();
    let video = sample("street.mp4");
    let cut = |begin: &str, end: &str| {
        let video = video.to_str().unwrap();
        omnilife([
            "curate", "slice", video, "--begin", begin, "--end", end, "--out", out, "--quiet",
        ])
    };
    let ended = cut("0.5", "1.25").succeeded();
    assert!(
        ended.stdout.contains(": 23 frames, 0.767 s"),
        "{}",
        ended.stdout
    );
    let cut_before = fs::read(out).unwrap();
    let message = cut("0", "1").failed_quietly(2).to_owned();
    assert!(message.contains("is not replaced"), "{message}");
    assert_eq!(fs::read(out).unwrap(), cut_before);
    fs::remove_file(out).unwrap();
    let message = cut("7", "8").failed_quietly(2).to_owned();
    assert!(
        message.contains("has no frame from 7 s to 8 s"),
        "{message}"
    );
}

/// The whole of the real footage: videos that show no sphere are rejected with a reason, the left eye of stereo is
/// taken, and the rest is a sound dataset.
#[test]
fn the_real_footage_becomes_a_sound_dataset() {
    let Some(reef) = footage("reef.mp4") else {
        return;
    };
    let folder = scratch();
    let out = folder.path().join("set");
    let data = reef.parent().unwrap();
    let ended = curate(&[data], &out, &["--criteria", "none"]);
    for said in [
        "bikes.mp4: rejected: its image is rectilinear",
        "congo_stereo.mp4: 1 sequence",
        "city4k.mp4: 1 sequence",
        "reef.mp4: 4 sequences",
        "tunnel.mp4: 1 sequence",
    ] {
        assert!(ended.stdout.contains(said), "{said}: {}", ended.stdout);
    }
    verify(&out).succeeded();
}

/// Reads by mlcroissant, where a Python has it: `OMNILIFE_TEST_PYTHON`, else `python3`.
#[test]
fn croissant_metadata_is_read_by_its_own_library() {
    let python = std::env::var("OMNILIFE_TEST_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_library = Command::new(&python)
        .args(["-c", "import mlcroissant"])
        .stderr(Stdio::null())
        .status();
    if !has_library.is_ok_and(|status| status.success()) {
        omnilife_schemas::testing::skip("no Python with mlcroissant (pip install mlcroissant)");
        return;
    }
    let dataset = copy_of_small_run();
    let folder = dataset.path().to_str().unwrap();
    let scratch = scratch();
    let tags = scratch.path().join("tags.csv");
    fs::write(
        &tags,
        "sequence,author,scene,action\nstreet/seq-000,Ada,beach,walking\n",
    )
    .unwrap();
    let tags = tags.to_str().unwrap();
    omnilife(["curate", "annotate", folder, "--tags", tags]).succeeded();
    omnilife(["curate", "publish", folder]).succeeded();
    let metadata = dataset.path().join("croissant.json");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/end_to_end/read_croissant.py");
    let read = Command::new(&python)
        .arg(script)
        .arg(&metadata)
        .output()
        .unwrap();
    let notes = String::from_utf8_lossy(&read.stderr);
    assert!(read.status.success(), "{notes}");
    assert!(!notes.contains("not standard"), "{notes}");
    assert_eq!(
        String::from_utf8_lossy(&read.stdout).trim(),
        "sequences 1, frames 10, masks 10, poses 10, points 1, annotations, splits 10"
    );
}
