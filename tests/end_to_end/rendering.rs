//! Gaussians of a run rendered along poses.

use std::{
    ffi::OsStr,
    fs,
    path::{Path, PathBuf},
};

use serde_json::Value;

use crate::support::{
    METHOD, SEQUENCE, SMALL_SIZE, omnilife, read_image, sample, scratch, small_run,
    write_tracked_split,
};

#[test]
fn a_run_rendered_along_its_scene_gives_its_predictions() {
    let run = small_run().out.join(METHOD).join("run");
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let folder = scratch();
    // Renders the Gaussians alone too: the run's record adds the normalization and the near limit.
    for gaussians in [run.clone(), run.join("gaussians.ply")] {
        let out = folder.path().join("views");
        let ended = omnilife([
            "reconstruct".as_ref(),
            "render".as_ref(),
            gaussians.as_os_str(),
            "--poses".as_ref(),
            scene.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
        ])
        .succeeded();
        assert!(ended.stdout.contains("10 views"), "{}", ended.stdout);
        for (kind, frame) in [("input", "000000.png"), ("novel", "000004.png")] {
            let predicted = read_image(&run.join("predictions").join(kind).join(frame));
            let rendered = read_image(&out.join(frame));
            let largest = predicted
                .iter()
                .zip(rendered.iter())
                .map(|(a, b)| a.abs_diff(*b))
                .max();
            // World coordinates are rounded once more in the file.
            assert!(largest <= Some(2), "{frame}: {largest:?}");
        }
    }
}

/// Canonical Gaussians, with the network beside them.
#[test]
fn deformed_gaussians_are_rendered_at_the_times_of_their_frames() {
    let sequence = small_run().out.join(SEQUENCE);
    let (scene, split) = (
        sequence.join("scene.json"),
        sequence.join("per-scene/split.json"),
    );
    let folder = scratch();
    let (run, out) = (folder.path().join("run"), folder.path().join("views"));
    let mut arguments = vec!["reconstruct".as_ref(), "train".as_ref(), scene.as_os_str()];
    arguments.extend([
        "--split".as_ref(),
        split.as_os_str(),
        "--out".as_ref(),
        run.as_os_str(),
    ]);
    let settings = [
        "--method",
        "deformable",
        "--iterations",
        "30",
        "--set",
        "max-gaussians=400",
    ];
    arguments.extend(settings.map(OsStr::new));
    omnilife(arguments).succeeded();
    let render = |layer: &str| {
        let mut arguments = ["--quiet", "reconstruct", "render"]
            .map(OsStr::new)
            .to_vec();
        arguments.extend([run.as_os_str(), "--poses".as_ref(), scene.as_os_str()]);
        arguments.extend(["--layer", layer, "--out"].map(OsStr::new));
        arguments.push(out.as_os_str());
        omnilife(arguments)
    };
    let message = render("dynamic").failed_quietly(2).to_owned();
    assert!(message.contains("a network deforms these"), "{message}");
    render("all").succeeded();
    for (kind, frame) in [("input", "000008.png"), ("novel", "000004.png")] {
        let predicted = read_image(&run.join("predictions").join(kind).join(frame));
        let rendered = read_image(&out.join(frame));
        let pairs = predicted.iter().zip(rendered.iter());
        let largest = pairs.map(|(a, b)| a.abs_diff(*b)).max();
        assert!(largest <= Some(2), "{frame}: {largest:?}");
    }
    // A submitted record may state any network.
    let record = run.join("run.json");
    let whole = fs::read_to_string(&record).unwrap();
    for (size, value) in [("width", 0_u64), ("width", u64::MAX), ("depth", 1 << 40)] {
        let mut changed: Value = serde_json::from_str(&whole).unwrap();
        changed["configuration"]["deformation"]["model"][size] = value.into();
        fs::write(&record, changed.to_string()).unwrap();
        let message = render("all").failed_quietly(2).to_owned();
        assert!(message.contains(size), "{message}");
    }
    fs::write(&record, whole).unwrap();
    fs::remove_file(run.join("deformation.safetensors")).unwrap();
    let message = render("all").failed_quietly(2).to_owned();
    assert!(message.contains("deformation.safetensors"), "{message}");
}

/// Edits of a vehicle leave Gaussians with times of their own as they are.
#[test]
fn a_vehicle_beside_gaussians_with_times_can_be_taken_out() {
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let folder = scratch();
    write_tracked_split(folder.path());
    let at = |name: &str| folder.path().join(name);
    let script = "[[edit]]\nkind = \"remove\"\nobject = \"1\"\n";
    fs::write(at("edit.toml"), script).unwrap();
    let run = |words: &[&str], paths: &[PathBuf]| {
        let words = words.iter().map(OsStr::new);
        let paths = paths.iter().map(|path| path.as_os_str());
        omnilife(words.chain(paths)).succeeded()
    };
    let split = at("split.json");
    let train = [
        "reconstruct",
        "train",
        "--method",
        "omni4dgs-plus",
        "--with",
        "tracked-objects",
        "--without",
        "aids",
        "--iterations",
        "3",
        "--set",
        "max-gaussians=400",
        "--split",
    ];
    run(&train, &[split, "--out".into(), at("run"), scene.clone()]);
    for file in [
        "gaussians-moving.ply",
        "objects.json",
        "gaussians-objects.ply",
    ] {
        assert!(at("run").join(file).is_file(), "{file}");
    }
    let edit = ["reconstruct", "edit", "--script"];
    run(
        &edit,
        &[at("edit.toml"), "--out".into(), at("edited"), at("run")],
    );
    for file in ["gaussians.ply", "gaussians-moving.ply"] {
        let [before, after] =
            ["run", "edited"].map(|folder| fs::read(at(folder).join(file)).unwrap());
        assert!(before == after, "{file}");
    }
    let objects = fs::read_to_string(at("edited/objects.json")).unwrap();
    let objects: Value = serde_json::from_str(&objects).unwrap();
    assert_eq!(objects["objects"].as_array().map(Vec::len), Some(0));
    let render = ["reconstruct", "render", "--size", "32x16", "--poses"];
    for name in ["run", "edited"] {
        run(
            &render,
            &[
                scene.clone(),
                "--out".into(),
                at("views").join(name),
                at(name),
            ],
        );
    }
    let [with, without] =
        ["run", "edited"].map(|name| read_image(&at("views").join(name).join("000000.png")));
    assert!(with.iter().ne(without.iter()));
}

/// A run that refines poses predicts the views of its Gaussians from the poses that it leaves.
#[test]
fn refined_poses_show_what_the_run_predicts() {
    let sequence = small_run().out.join(SEQUENCE);
    let (scene, split) = (
        sequence.join("scene.json"),
        sequence.join("per-scene/split.json"),
    );
    let folder = scratch();
    let (run, out) = (folder.path().join("run"), folder.path().join("views"));
    let mut arguments = vec!["reconstruct".as_ref(), "train".as_ref(), scene.as_os_str()];
    arguments.extend(["--split".as_ref(), split.as_os_str()]);
    arguments.extend(["--out".as_ref(), run.as_os_str()]);
    let settings = ["--method", "omni4dgs-plus", "--plan", "pose-refinement"];
    arguments.extend(settings.map(OsStr::new));
    arguments.extend(["--iterations", "30", "--set", "max-gaussians=400"].map(OsStr::new));
    omnilife(arguments).succeeded();
    let size = format!("{}x{}", SMALL_SIZE.0, SMALL_SIZE.1);
    let render = |poses: &Path| {
        let mut arguments = ["--quiet", "reconstruct", "render"]
            .map(OsStr::new)
            .to_vec();
        arguments.extend([run.as_os_str(), "--poses".as_ref(), poses.as_os_str()]);
        arguments.extend(["--size", &size, "--out"].map(OsStr::new));
        arguments.push(out.as_os_str());
        omnilife(arguments).succeeded();
    };
    let poses = run.join("refined-poses.json");
    render(&poses);
    for (kind, frame) in [("input", "000008.png"), ("novel", "000004.png")] {
        let predicted = read_image(&run.join("predictions").join(kind).join(frame));
        let rendered = read_image(&out.join(frame));
        let pairs = predicted.iter().zip(rendered.iter());
        let largest = pairs.map(|(a, b)| a.abs_diff(*b)).max();
        assert!(largest <= Some(2), "{frame}: {largest:?}");
    }
    let [refined, given] = [&poses, &scene].map(|file| {
        let record: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
        record["frames"][8]["pose"]["centre"].clone()
    });
    assert!(refined.is_array() && refined != given, "{refined}");
}

#[test]
fn a_pinhole_camera_sees_what_its_field_of_view_holds() {
    let run = small_run().out.join(METHOD).join("run");
    let folder = scratch();
    let (views, video) = (folder.path().join("views"), folder.path().join("a.mp4"));
    let poses = sample("poses.json");
    let mut arguments = vec!["reconstruct".as_ref(), "render".as_ref(), run.as_os_str()];
    arguments.extend(["--poses".as_ref(), poses.as_os_str(), "--out".as_ref()]);
    arguments.push(views.as_os_str());
    arguments.extend(["--size", "31x20", "--camera", "pinhole"].map(OsStr::new));
    arguments.extend(["--fov-degrees", "60"].map(OsStr::new));
    arguments.extend(["--video".as_ref(), video.as_os_str()]);
    let ended = omnilife(arguments).succeeded();
    assert!(ended.stdout.contains("60 views"), "{}", ended.stdout);
    let image = read_image(&views.join("000000.png"));
    assert_eq!(image.dimensions(), (31, 20));
    // The view straight ahead is in the middle of both images.
    let erp = read_image(&run.join("predictions/input/000000.png"));
    let centre = erp.get_pixel(SMALL_SIZE.0 / 2, SMALL_SIZE.1 / 2).0;
    let middle = image.get_pixel(15, 10).0;
    for (a, b) in centre.iter().zip(middle) {
        assert!(a.abs_diff(b) < 60, "{centre:?} and {middle:?}");
    }
    assert!(ended.stdout.contains("30.000 frames per second"));
    assert!(fs::metadata(&video).unwrap().len() > 1_000);
    // The encoder's own remarks are suppressed.
    assert!(!ended.stderr.contains("264"), "{}", ended.stderr);
}

/// A file that `scripts/golden/splat_formats.mjs` had another program write.
fn file_of_another_program() -> PathBuf {
    let peer = "reconstruct/training/src/formats/exchange/peer/peer.sog";
    Path::new(env!("CARGO_MANIFEST_DIR")).join(peer)
}

#[test]
fn files_of_other_programs_become_360_degree_video_and_faces_of_cubes() {
    let (folder, poses) = (scratch(), sample("poses.json"));
    let (model, video) = (file_of_another_program(), folder.path().join("a.mp4"));
    let rendered = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let mut arguments = vec!["reconstruct".as_ref(), "render".as_ref(), model.as_os_str()];
        arguments.extend(["--poses".as_ref(), poses.as_os_str(), "--out".as_ref()]);
        arguments.push(out.as_os_str());
        arguments.extend(more.iter().map(OsStr::new));
        let ended = omnilife(arguments).succeeded();
        assert!(ended.stdout.contains("60 views"), "{}", ended.stdout);
        fs::read_dir(&out).unwrap().count()
    };
    let shown = video.to_str().unwrap();
    let sphere = ["--projection", "erp", "--size", "64x32", "--video", shown];
    assert!(rendered("sphere", &sphere) >= 60);
    let bytes = fs::read(&video).unwrap();
    for marked in [b"sv3d", b"st3d", b"equi"] {
        assert!(bytes.windows(4).any(|word| word == marked), "{marked:?}");
    }
    let cube = ["--projection", "cube", "--size", "8x8", "--axes=x,-z,y"];
    assert!(rendered("cube", &cube) >= 360);
    let face = read_image(&folder.path().join("cube/000059-down.png"));
    assert_eq!(face.dimensions(), (8, 8));
}

#[test]
fn what_cannot_be_rendered_is_refused_in_one_line() {
    let folder = scratch();
    let run = small_run().out.join(METHOD).join("run");
    let points = sample("points.ply");
    let (poses, scene) = (sample("poses.json"), run.join("run.json"));
    let out = folder.path().join("views");
    let refused = |gaussians: &Path, poses: &Path, more: &[&str]| {
        let mut arguments = ["--quiet", "reconstruct", "render"]
            .map(AsRef::as_ref)
            .to_vec();
        arguments.extend([gaussians.as_os_str(), "--poses".as_ref(), poses.as_os_str()]);
        arguments.extend(["--out".as_ref(), out.as_os_str()]);
        arguments.extend(more.iter().map(OsStr::new));
        omnilife(arguments).failed_quietly(2).to_owned()
    };
    let message = refused(&points, &poses, &[]);
    assert!(
        message.contains("points.ply") && message.contains("a point cloud"),
        "{message}"
    );
    // A header that states no vertex before those that follow.
    let whole = fs::read(run.join("gaussians.ply")).unwrap();
    let end = whole
        .windows(10)
        .position(|word| word == b"end_header")
        .unwrap();
    let header = String::from_utf8_lossy(&whole[..end]);
    let lines = header
        .lines()
        .map(|line| match line.starts_with("element vertex") {
            true => "element vertex 0\n".to_owned(),
            false => format!("{line}\n"),
        });
    let header: String = lines.collect();
    let empty = folder.path().join("empty.ply");
    fs::write(&empty, [header.as_bytes(), &whole[end..]].concat()).unwrap();
    let message = refused(&empty, &poses, &[]);
    assert!(message.contains("must hold Gaussians"), "{message}");
    let message = refused(&run, &scene, &[]);
    assert!(message.contains("omnilife/run/2"), "{message}");
    let message = refused(
        &run,
        &poses,
        &["--camera", "pinhole", "--fov-degrees", "180"],
    );
    assert!(message.contains("between 0 and 180 degrees"), "{message}");
    let message = refused(&run, &poses, &["--axes", "-x,y,-z"]);
    assert!(message.contains("axes are those of a file"), "{message}");
    let message = refused(&run, &poses, &["--projection", "cube", "--video", "a.mp4"]);
    assert!(message.contains("a cube has six"), "{message}");
    let message = refused(&run, &poses, &["--video", "a.webm"]);
    assert!(message.contains(".mp4"), "{message}");
    assert!(!out.exists());
}

/// Views around the scene: one word at a time, with a table and a record beside the images.
#[test]
fn cameras_by_words_exclude_each_other_and_leave_a_table() {
    let run = small_run().out.join(METHOD).join("run");
    let scene = small_run().out.join(SEQUENCE).join("scene.json");
    let folder = scratch();
    let out = folder.path().join("views");
    let render = |words: &[&str]| {
        let mut arguments = ["--quiet", "reconstruct", "render"]
            .map(OsStr::new)
            .to_vec();
        arguments.extend([run.as_os_str(), "--poses".as_ref(), scene.as_os_str()]);
        arguments.extend(["--out".as_ref(), out.as_os_str()]);
        arguments.extend(words.iter().map(OsStr::new));
        omnilife(arguments)
    };
    for (words, reason) in [
        (&["--orbit", "90", "--from-above"][..], "--from-above"),
        (&["--stationary", "1", "--path", "a.csv"][..], "--path"),
        (&["--path", "a.csv", "--look-at", "0,0,1"][..], "--look-at"),
        (&["--stationary", "99"][..], "has no frame 99"),
        (&["--look-at", "7"][..], "must have objects to show \"7\""),
        (&["--orbit", "0"][..], "degrees"),
        (&["--up", "0,0,1"][..], "--up goes with"),
        (
            &["--stationary", "1", "--up", "0,0,1"][..],
            "--up goes with",
        ),
    ] {
        let message = render(words).failed_quietly(2).to_owned();
        assert!(message.contains(reason), "{message}");
        assert!(!out.exists(), "{words:?}");
    }
    let ended = render(&["--stationary", "1"]).succeeded();
    assert!(ended.stdout.contains("10 views"), "{}", ended.stdout);
    assert!(ended.stdout.contains("unseen"), "{}", ended.stdout);
    let record: Value =
        serde_json::from_str(&fs::read_to_string(out.join("cameras.json")).unwrap()).unwrap();
    assert_eq!(record["cameras"], "stationary 1");
    assert_eq!(record["views"].as_array().map(Vec::len), Some(10));
}
