//! Boxes of a program that the tracker runs.

use omnilife_tracks::detectors::{command, motion};

use super::*;

/// A request for a program, a shell script that appends to `runs.txt` beside its TOML and copies `found.txt`.
fn program_request(folder: &Path, further: &str) -> TrackRequest {
    let script =
        "echo run >> \"$1/runs.txt\"\nls \"$2\" > \"$1/frames.txt\"\ncp \"$1/found.txt\" \"$3\"\n";
    fs::write(folder.join("detect.sh"), script).unwrap();
    let toml = folder.join("program.toml");
    let text = format!(
        "id = \"copier\"\ncommand = [\"sh\", \"{{folder}}/detect.sh\", \"{{folder}}\", \"{{frames}}\", \
         \"{{boxes}}\"]\nformat = \"mot\"\n{further}"
    );
    fs::write(&toml, text).unwrap();
    TrackRequest {
        options: TrackOptions {
            detector: &command::DETECTOR,
            program: Some(toml),
            ..TrackOptions::default()
        },
        ..request(folder, "")
    }
}

#[test]
fn a_program_finds_boxes_once_and_what_does_not_count_is_left_out() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let scene = write_scene(&folder.join("scene"));
    // Cars are class 3; a tree, and a car that the program hardly believes in, do not count.
    let mut found: String = boxes(&scene)
        .lines()
        .map(|line| format!("{line},3\n"))
        .collect();
    found += "1,-1,5,5,9,9,0.9,7\n2,-1,5,5,9,9,0.1,3\n";
    fs::write(folder.join("found.txt"), &found).unwrap();
    let kept = "minimum_confidence = 0.5\n[classes]\n3 = \"car\"\n";
    let asked = program_request(folder, kept);
    let plan = plan_tracks(&asked, &Silent).unwrap();
    assert!(!plan.is_known && !folder.join("tracks/tracks.json").exists());
    let tracks = make_tracks(&asked, &Silent).unwrap();
    // The plan has run it already.
    let runs = || fs::read_to_string(folder.join("runs.txt")).unwrap();
    assert_eq!(runs(), "run\n");
    let frames = fs::read_to_string(folder.join("frames.txt")).unwrap();
    assert_eq!(frames.lines().count(), FRAMES);
    assert!(frames.starts_with("000000.png\n000001.png\n"), "{frames}");
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    assert!(tracks.tracks.iter().all(|track| track.class == "car"));
    let sha256 = store::sha256_file(asked.options.program.as_ref().unwrap()).unwrap();
    let said = &tracks.stages[0].reason;
    let parts = [
        "copier by",
        &sha256,
        "1 are below its confidence, 1 of other classes",
    ];
    assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    // The same boxes by the other detector.
    let mut by_file = request(folder, &boxes(&scene));
    by_file.out = folder.join("by-file");
    let of_file = make_tracks(&by_file, &Silent).unwrap();
    assert_eq!(
        tracks
            .tracks
            .iter()
            .map(|track| &track.path)
            .collect::<Vec<_>>(),
        of_file
            .tracks
            .iter()
            .map(|track| &track.path)
            .collect::<Vec<_>>()
    );
    // Another way of tracking has the boxes; another program, or another script of it, has not.
    let mut by_appearance = asked.clone();
    by_appearance.options.distance = DistanceMethod::Ground;
    make_tracks(&by_appearance, &Silent).unwrap();
    assert_eq!(runs(), "run\n");
    let known = plan_tracks(&by_appearance, &Silent).unwrap();
    assert!(known.is_known && known.moving == 2);
    let text = known.text();
    for part in [
        "| detector: command | yes |",
        "| object-graph | yes | 2 vehicles move |",
        "static",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let lines = fs::read_to_string(folder.join("detect.sh")).unwrap();
    fs::write(folder.join("detect.sh"), lines + "# changed\n").unwrap();
    make_tracks(&by_appearance, &Silent).unwrap();
    assert_eq!(runs(), "run\nrun\n");
}

#[test]
fn programs_that_fail_are_told_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    write_scene(&folder.join("scene"));
    let refusal = |request: &TrackRequest| {
        let error = make_tracks(request, &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        let message = error.to_string();
        assert!(!message.contains('\n'), "{message}");
        assert!(!folder.join("tracks/tracks.json").exists());
        assert!(!folder.join("tracks/boxes.txt").exists());
        message
    };
    // `found.txt` is not there: cp says so, and the script ends as cp does.
    let message = refusal(&program_request(folder, ""));
    assert!(
        message.contains("program.toml: copier ended with exit 1: cp")
            && message.contains("found.txt"),
        "{message}"
    );
    fs::write(folder.join("found.txt"), "99,-1,1,1,9,9,1\n").unwrap();
    let error = make_tracks(&program_request(folder, ""), &Silent).unwrap_err();
    assert!(
        error.to_string().contains("line 1: is of frame 99"),
        "{error}"
    );
    fs::remove_dir_all(folder.join("tracks")).unwrap();
    let toml = folder.join("program.toml");
    for (text, reason) in [
        ("id = 3\n", "line 1: invalid type"),
        (
            "command = [\"true\"]\nformat = \"mot\"\n",
            "missing field `id`",
        ),
        (
            "id = \"a\"\ncommand = [\"true\", \"{frames}\"]\nformat = \"mot\"\n",
            "does not say {boxes}",
        ),
        (
            "id = \"a\"\ncommand = [\"true\", \"{frame}\"]\nformat = \"mot\"\n",
            "{frame} is not known; there are {frames}",
        ),
        (
            "id = \"a\"\ncommand = [\"true\", \"{frames}{boxes}\"]\nformat = \"mot\"\n",
            "a ended without writing {boxes}",
        ),
        (
            "id = \"a\"\ncommand = [\"sleep\", \"9\", \"{frames}{boxes}\"]\nformat = \"mot\"\n\
             time_limit_seconds = -1\n",
            "the time limit must be positive, got -1 s",
        ),
        (
            "id = \"a\"\ncommand = [\"/nonexistent\", \"{frames}{boxes}\"]\nformat = \"mot\"\n",
            "/nonexistent could not be started",
        ),
        (
            "id = \"a\"\ncommand = [\"true\", \"{frames}{boxes}\"]\nformat = \"yolo\"\n",
            "line 3: unknown variant `yolo`",
        ),
    ] {
        let asked = program_request(folder, "");
        fs::write(&toml, text).unwrap();
        let message = refusal(&asked);
        assert!(
            message.contains("program.toml") && message.contains(reason),
            "{message}"
        );
    }
    let mut without = program_request(folder, "");
    without.options.program = None;
    assert!(refusal(&without).contains("--program FILE.toml"));
    let mut unused = program_request(folder, "");
    unused.options.detector = &motion::DETECTOR;
    assert!(refusal(&unused).contains("--program is for the detector command"));
}
