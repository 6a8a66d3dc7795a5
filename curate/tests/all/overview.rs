//! The page of a dataset, and what it says of every sequence.

use std::{fs, path::Path};

use glam::DQuat;
use omnilife_curate::{
    CurateSettings, curate_dataset,
    masks::{MaskSource, write_masks},
    overview::{status, table, write_page},
    publish::{PublishSettings, publish, verify},
};
use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    points::PointCloud,
    progress::Silent,
    records::{
        DatasetStatus, PartState, PartStatus, Sampling, Scale, Scene, SceneFrame, Sequence,
        SequencePart,
    },
    rgb::{self, Mask},
    store,
};
use support::{Clip, erp_clip, world_colour};

use crate::support;

fn settings() -> CurateSettings {
    CurateSettings {
        profile: "none".to_owned(),
        sampling: Sampling::MaxFrames(10),
        ..CurateSettings::default()
    }
}

/// Writes an ordinary perspective video, which curation rejects.
fn flat(path: &Path) {
    Clip::steady(320, 180, 40, 20).write(path, |frame, x, y| {
        let (u, v) = (x as f64 / 160.0 - 1.0, y as f64 / 160.0 - 0.56);
        world_colour(1, [1.7 * u, 2.3 * v, 0.3 * u * v + 0.01 * frame as f64])
    });
}

fn page(folder: &Path) -> String {
    let path = write_page(folder, &Silent).unwrap();
    fs::read_to_string(path).unwrap()
}

#[track_caller]
fn part(status: &DatasetStatus, part: SequencePart) -> PartStatus {
    status.sequences[0].part(part).unwrap().clone()
}

/// Gives a sequence masks of another program.
fn mask(folder: &Path) {
    let sequence: Sequence = store::read_record(&folder.join("sequence.json")).unwrap();
    let given = folder.join("given");
    fs::create_dir(&given).unwrap();
    let (width, height) = (
        sequence.frames.width as usize,
        sequence.frames.height as usize,
    );
    for frame in &sequence.frames.entries {
        let pixels = (0..width * height).map(|at| 255 * u8::from(at % width < width / 4));
        let mask = Mask::new(width, height, pixels.collect());
        let name = Path::new(&frame.file).file_name().unwrap();
        mask.write_png(&given.join(name)).unwrap();
    }
    write_masks(folder, &MaskSource::Files(given.clone()), &Silent).unwrap();
    fs::remove_dir_all(given).unwrap();
}

#[test]
fn a_dataset_says_what_it_has_lacks_and_lost() {
    let temp = tempfile::tempdir().unwrap();
    let walk = erp_clip(temp.path(), "my walk.mp4", &[1], 20, 10);
    let other = temp.path().join("flat.mp4");
    flat(&other);
    let out = temp.path().join("set");
    drop(curate_dataset(&[walk, other], &out, &settings(), &Silent).unwrap());
    publish(&out, &PublishSettings::default(), &Silent).unwrap();
    let first = page(&out);
    assert_eq!(first, page(&out), "the same records give the same bytes");
    assert_eq!(verify(&out, &Silent).unwrap(), [""; 0]);

    let before = status(&out, ".").unwrap();
    let written: DatasetStatus = store::read_record(&out.join("status.json")).unwrap();
    assert_eq!(before, written);
    let [lost] = before.lost.as_slice() else {
        panic!("{:?}", before.lost);
    };
    assert_eq!(
        (lost.file.as_str(), lost.outcome.as_str()),
        ("flat.mp4", "rejected")
    );
    let frames = part(&before, SequencePart::Frames);
    assert_eq!((frames.state, frames.count), (PartState::Present, 10));
    assert_eq!(frames.command, None);
    let folder = before.sequences[0].folder.clone();
    let poses = part(&before, SequencePart::Poses);
    assert_eq!(poses.state, PartState::Missing);
    let command = poses.command.unwrap();
    assert!(
        command.starts_with("omnilife curate poses ") && command.contains(&folder),
        "{command}"
    );

    assert!(first.trim_end().ends_with("</html>"));
    assert_eq!(
        first.matches("<img src=\"data:image/jpeg;base64,").count(),
        8
    );
    assert!(
        !first.contains("moving region marked")
            && !first.contains("http:")
            && !first.contains("https:")
    );
    assert!(first.contains("flat.mp4") && first.contains("rectilinear"));

    mask(&out.join(&folder));
    let after = status(&out, "set").unwrap();
    let masks = part(&after, SequencePart::Masks);
    assert_eq!(
        (masks.state, masks.note.as_str()),
        (PartState::Present, "files")
    );
    // The masks that were found are used for poses.
    let command = part(&after, SequencePart::Poses).command.unwrap();
    assert!(
        command.contains("--masks") && command.contains(&format!("set/{folder}")),
        "{command}"
    );
    let marked = page(&out);
    assert_eq!(marked.matches("moving region marked").count(), 8);
    assert_ne!(first, marked);
}

#[test]
fn a_missing_or_broken_frame_is_said_and_the_others_are_shown() {
    let temp = tempfile::tempdir().unwrap();
    let walk = erp_clip(temp.path(), "walk.mp4", &[1], 20, 10);
    let out = temp.path().join("set");
    drop(curate_dataset(&[walk], &out, &settings(), &Silent).unwrap());
    let frames = out.join("videos/walk/seq-000/frames");
    let names = store::names_in(&frames).unwrap();
    fs::remove_file(frames.join(&names[0])).unwrap();
    fs::write(frames.join(&names[9]), "no image").unwrap();
    let state = status(&out, ".").unwrap();
    let images = part(&state, SequencePart::Frames);
    assert_eq!(
        (images.state, images.count, images.of),
        (PartState::Incomplete, 9, 10)
    );
    assert_eq!(
        images.command.as_deref(),
        Some("omnilife curate VIDEOS --out .")
    );
    let page = page(&out);
    assert_eq!(page.matches("<img ").count(), 6);
    assert_eq!(page.matches("class=\"fault\"").count(), 2, "{page}");
    let place = temp.path().display().to_string();
    assert!(
        !page.contains(&place),
        "no path of this machine is on the page"
    );
}

/// Writes a scene as an import leaves it: no sequence.json, a camera that goes along z.
fn imported(folder: &Path) {
    fs::create_dir_all(folder.join("frames")).unwrap();
    let frames = (0..4_u8).map(|index| {
        let image = format!("frames/{index:06}.png");
        let pixels = vec![40 * index; 32 * 16 * 3];
        rgb::write_rgb8_png(&folder.join(&image), 32, 16, &pixels).unwrap();
        SceneFrame::new(
            image,
            0.5 * f64::from(index),
            Some(Pose::new(
                DQuat::IDENTITY,
                [0.0, 0.0, f64::from(index)].into(),
            )),
        )
    });
    let scene = Scene {
        scale: Scale::Metres,
        points: Some("points.ply".to_owned()),
        ..Scene::given("hall", ErpCamera::new(32, 16), frames.collect())
    };
    let positions = vec![[0.0, -50.0, 1.5], [0.0, 50.0, 1.5]];
    let points = PointCloud::of_colour(positions, [1, 2, 3]);
    points.write_ply(&folder.join("points.ply")).unwrap();
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
}

#[test]
fn imported_scenes_have_a_page_without_a_dataset() {
    let temp = tempfile::tempdir().unwrap();
    let hall = temp.path().join("scenes/hall");
    imported(&hall);
    let alone = status(&hall, "scenes/hall").unwrap();
    assert_eq!(alone.sequences[0].folder, ".");
    assert_eq!(alone.sequences[0].part(SequencePart::Annotation), None);
    let masks = part(&alone, SequencePart::Masks).command;
    assert_eq!(
        masks.as_deref(),
        Some("omnilife curate attach scenes/hall --masks MASKS")
    );
    let split = part(&alone, SequencePart::Splits).command;
    assert_eq!(
        split.as_deref(),
        Some(
            "omnilife bench split scenes/hall --protocol per-scene --out scenes/hall/per-scene/split.json"
        )
    );

    let together = status(&temp.path().join("scenes"), ".").unwrap();
    assert_eq!(together.sequences[0].folder, "hall");
    assert!((together.sequences[0].duration_seconds - 1.5).abs() < 1e-12);
    let shown = page(&temp.path().join("scenes"));
    assert!(shown.contains("4 poses, 3.0 m"), "{shown}");
    // One point straight above and one straight below every camera.
    assert!(shown.matches("50.0 %").count() == 2, "{shown}");
    assert!(!shown.contains("Losses at each check"));
    assert!(
        table(&together)
            .whole
            .contains("curate attach hall --masks MASKS")
    );
}

#[test]
fn a_dataset_without_sequences_has_a_page_too() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("flat.mp4");
    flat(&video);
    let out = temp.path().join("set");
    drop(curate_dataset(&[video], &out, &settings(), &Silent).unwrap());
    let state = status(&out, ".").unwrap();
    let text = table(&state).whole;
    assert!(
        text.starts_with("no sequences\nflat.mp4: rejected: "),
        "{text}"
    );
    let page = page(&out);
    assert!(
        page.contains("0 sequences, 0.0 s, from 0 of 1 video."),
        "{page}"
    );
    assert!(
        page.contains("Losses at each check") && !page.contains("NaN"),
        "{page}"
    );
}

#[test]
fn other_folders_and_foreign_pages_are_refused_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let missing = status(&temp.path().join("nowhere"), ".")
        .unwrap_err()
        .to_string();
    assert!(
        missing.ends_with("nowhere: must be the folder of a dataset"),
        "{missing}"
    );
    let empty = status(temp.path(), ".").unwrap_err().to_string();
    assert!(
        empty.contains("holds neither a dataset.json nor a scene.json"),
        "{empty}"
    );
    assert_eq!(empty.lines().count(), 1);

    imported(temp.path());
    let mine = temp.path().join("index.html");
    fs::write(&mine, "my page").unwrap();
    let refused = write_page(temp.path(), &Silent).unwrap_err().to_string();
    assert!(refused.contains("index.html"), "{refused}");
    assert_eq!(fs::read_to_string(mine).unwrap(), "my page");
}
