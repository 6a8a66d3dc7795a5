//! Programs that make what is attached: good ones, and those that fail in every way.

use std::time::{Duration, Instant};

use omnilife_curate::{FrameCommand, FramePrograms, PriorProgram};

use super::*;

/// The command of a shell script with this text, which has the folders of frames and of its files as `$1` and `$2`.
fn script(scenes: &Scenes, text: &str) -> FrameCommand {
    let file = scenes.folder.join("program.sh");
    fs::write(&file, text).unwrap();
    let command = format!("sh {} {{frames}} {{out}} {{times}}", file.display());
    command.parse().unwrap()
}

/// A script that leaves a file of a folder for every frame that it is shown.
fn giving(scenes: &Scenes, folder: &Path, kind: &str) -> FrameCommand {
    let text = format!(
        "for frame in $1/*; do cp {}/$(basename $frame .png).{kind} $2/; done",
        folder.display()
    );
    script(scenes, &text)
}

fn masking(command: FrameCommand) -> FramePrograms {
    FramePrograms {
        masks: Some(command),
        ..FramePrograms::default()
    }
}

fn estimating(command: FrameCommand) -> FramePrograms {
    let prior = PriorProgram {
        command,
        unit: 0.5,
        grid: DistanceGrid::HalfPixel,
        convention: DistanceConvention::Ray,
    };
    FramePrograms {
        prior: Some(prior),
        ..FramePrograms::default()
    }
}

fn posing(command: FrameCommand) -> FramePrograms {
    FramePrograms {
        poses: Some(command),
        ..FramePrograms::default()
    }
}

fn run(scenes: &Scenes, programs: FramePrograms) -> Result<Scene, CurateError> {
    let request = AttachRequest {
        programs,
        ..AttachRequest::default()
    };
    omnilife_curate::attach(&scenes.imported, &request, &Silent)
}

/// The file of matrices of a camera that goes along x.
fn matrices(scenes: &Scenes, count: usize) -> PathBuf {
    let file = scenes.folder.join("all_poses.npy");
    let rows = |frame: usize| {
        let x = frame as f32;
        [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    };
    let values: Vec<f32> = (0..count).flat_map(rows).collect();
    npy::write_f32(&file, &[count, 3, 4], &values).unwrap();
    file
}

#[test]
fn masks_and_distances_of_programs_are_those_of_the_frames() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    // Names in another order than that of time: programs see numbers.
    let path = scenes.imported.join("scene.json");
    let mut scene: Scene = store::read_record(&path).unwrap();
    for (number, frame) in scene.frames.iter_mut().enumerate() {
        let image = format!("frames/{}.png", FRAMES - number);
        let shown = scenes.sequence.join(format!("frames/{number:06}.png"));
        fs::copy(shown, scenes.imported.join(&image)).unwrap();
        frame.image = image;
    }
    store::write_record(&path, &scene).unwrap();

    let masks = scenes.masks("moving", 20);
    let command = giving(&scenes, &masks, "png");
    let scene = run(&scenes, masking(command.clone())).unwrap();
    for (number, frame) in scene.frames.iter().enumerate() {
        let mask = Mask::read(&scenes.imported.join(frame.mask.as_ref().unwrap())).unwrap();
        let white = mask.data.iter().filter(|&&value| value != 0).count();
        assert_eq!(white, 128 * (20 + number));
    }
    let by = |scene: &Scene| {
        let lines = scene.validation.problems.iter();
        lines.filter(|line| line.contains("program.sh")).count()
    };
    assert_eq!(by(&scene), 1);

    let prior = scenes.prior([16, 32], 4.0);
    let command = giving(&scenes, &prior.folder, "npy");
    let scene = run(&scenes, estimating(command)).unwrap();
    for frame in &scene.frames {
        let found = frame.depth_prior.as_ref().unwrap();
        assert!(found.source.contains("program.sh {frames} {out}"));
        let values = npy::read(&scenes.imported.join(&found.file))
            .unwrap()
            .values;
        assert!(values.iter().all(|&value| value == 2.0));
        assert!(frame.mask.is_some());
    }
    // Masks that are given replace those of the program, and the line on it.
    let given = GivenTruth {
        masks: Some(masks_of_names(&scenes)),
        ..GivenTruth::default()
    };
    assert_eq!(
        by(&attach(&scenes.imported, None, &given, &Silent).unwrap()),
        0
    );
}

/// Masks of a failed program are in its folder again, unless the command or a frame is another one.
#[test]
fn masks_of_a_failed_program_are_found_by_its_next_run() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let (masks, found) = (scenes.masks("moving", 20), scenes.folder.join("found"));
    // Skips what is masked, and after some further masks breaks off in the middle of one.
    let masking_at_most = |most: usize| {
        let (masks, found) = (masks.display(), found.display());
        let text = format!(
            "ls $2 | wc -l > {found}; made=0
             for frame in $1/*; do
               name=$(basename $frame); [ -e $2/$name ] && continue
               if [ $made = {most} ]; then head -c 40 {masks}/$name > $2/$name; exit 3; fi
               cp {masks}/$name $2/; made=$((made + 1))
             done"
        );
        masking(script(&scenes, &text))
    };
    let found_by_the_last = || -> usize {
        let text = fs::read_to_string(&found).unwrap();
        text.trim().parse().unwrap()
    };
    let fails_after = |most: usize| {
        let message = run(&scenes, masking_at_most(most)).unwrap_err().to_string();
        assert!(
            message.contains('3') && !message.contains('\n'),
            "{message}"
        );
        found_by_the_last()
    };
    let unfinished = scenes.imported.join(".unfinished-masks");
    assert_eq!(fails_after(0), 0);
    assert!(!unfinished.exists());
    assert_eq!(fails_after(3), 0);
    assert_eq!(fails_after(1), 3);

    let scene: Scene = store::read_record(&scenes.imported.join("scene.json")).unwrap();
    let first = scenes.imported.join(&scene.frames[0].image);
    let before = fs::read(&first).unwrap();
    fs::write(&first, [&*before, b"\n"].concat()).unwrap();
    assert_eq!(fails_after(2), 0);
    masking_at_most(1);
    let program = scenes.folder.join("program.sh");
    let other = format!("sh {} {{frames}} {{out}}", program.display());
    run(&scenes, masking(other.parse().unwrap())).unwrap_err();
    assert_eq!(found_by_the_last(), 0);
    assert_eq!(fails_after(2), 0);

    let scene = run(&scenes, masking_at_most(FRAMES)).unwrap();
    assert_eq!(found_by_the_last(), 2);
    assert!(scene.frames.iter().all(|frame| frame.mask.is_some()));
    assert!(!unfinished.exists());
}

/// Masks by the names that the frames of the imported scene have.
fn masks_of_names(scenes: &Scenes) -> PathBuf {
    let (from, to) = (scenes.masks("moving", 20), scenes.folder.join("named"));
    fs::create_dir(&to).unwrap();
    for number in 0..FRAMES {
        let name = format!("{}.png", FRAMES - number);
        fs::copy(from.join(format!("{number:06}.png")), to.join(name)).unwrap();
    }
    to
}

#[test]
fn poses_of_programs_are_matrices_or_a_record() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "nerfstudio");
    take_poses(&scenes);
    let file = matrices(&scenes, FRAMES);
    // It gets the times of all frames, with a line for their names.
    let text = format!(
        "test $(wc -l < $3) = {} && cp {} $2/",
        FRAMES + 1,
        file.display()
    );
    let command = script(&scenes, &text);
    let request = AttachRequest {
        programs: posing(command),
        given: GivenTruth {
            pose_convention: Some(PoseConvention::CameraToWorld),
            ..GivenTruth::default()
        },
        ..AttachRequest::default()
    };
    let scene = omnilife_curate::attach(&scenes.imported, &request, &Silent).unwrap();
    assert_eq!(scene.frames[3].pose.unwrap().centre, [3.0, 0.0, 0.0]);
    let PoseSource::Program {
        command,
        file,
        convention,
    } = &scene.pose_source
    else {
        panic!("{:?}", scene.pose_source);
    };
    assert!(command.contains("program.sh") && *file == "all_poses.npy");
    assert_eq!(*convention, Some(PoseConvention::CameraToWorld));

    take_poses(&scenes);
    let text = format!("cp {} $2/", scenes.folder.join("poses.json").display());
    let scene = run(&scenes, posing(script(&scenes, &text))).unwrap();
    assert_eq!(scene.scale, Scale::Metres);
    assert_eq!(scene.validation.registered_frames, FRAMES as u32);
}

#[test]
fn programs_that_fail_change_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    // Masks of a program that failed are kept for its next run.
    let content = |folder: &Path| {
        let mut files = content(folder);
        files.retain(|path, _| !path.starts_with(folder.join(".unfinished-masks")));
        files
    };
    let refused = |programs: FramePrograms, reason: &str| {
        let before = content(&scenes.imported);
        let error = run(&scenes, programs).map(drop).unwrap_err();
        let message = error.to_string();
        assert_eq!(error.error_kind(), ErrorKind::User, "{message}");
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{message}"
        );
        assert!(content(&scenes.imported) == before, "{message}");
    };
    let crash = "echo began; echo no weights >&2; exit 3";
    refused(masking(script(&scenes, crash)), "no weights");
    refused(estimating(script(&scenes, crash)), "no weights");
    refused(
        masking("/nowhere/net {frames} {out}".parse().unwrap()),
        "/nowhere/net",
    );

    let begun = Instant::now();
    let hanging = FramePrograms {
        time_limit: Some(Duration::from_millis(300)),
        ..masking(script(&scenes, "sleep 300 & sleep 300"))
    };
    refused(hanging, "time limit");
    assert!(begun.elapsed() < Duration::from_secs(60));

    refused(masking(script(&scenes, "true")), "0 of 12 frames");
    let masks = scenes.masks("moving", 20);
    let text = format!("cp {}/*.png $2/; rm $2/000007.png", masks.display());
    refused(masking(script(&scenes, &text)), "000007");
    let prior = scenes.prior([16, 20], 4.0);
    refused(
        estimating(giving(&scenes, &prior.folder, "npy")),
        "another shape",
    );

    // The scene has poses, and a program is not even started.
    let trace = scenes.folder.join("started");
    let text = format!("touch {}", trace.display());
    refused(posing(script(&scenes, &text)), "has poses of 12 of 12");
    assert!(!trace.exists());
    take_poses(&scenes);
    refused(posing(script(&scenes, "exit 1")), "program.sh");
    refused(posing(script(&scenes, "true")), "neither");
    let text = "touch $2/poses.json $2/all_poses.npy";
    refused(posing(script(&scenes, text)), "both");
    let file = matrices(&scenes, FRAMES - 1);
    let text = format!("cp {} $2/", file.display());
    refused(posing(script(&scenes, &text)), "--poses-convention");
}
