//! Times of given poses beside those of the frames.

use super::*;

#[test]
fn times_of_another_unit_are_reported() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let milliseconds =
        (0..20).map(|n| PosedFrame::new(100.0 * f64::from(n), pose_at(f64::from(n))));
    let record = Poses::new(Scale::Metres, None, milliseconds.collect());
    let file = temp.path().join("poses.json");
    store::write_record(&file, &record).unwrap();
    let notes = Notes::default();
    pose_sequence(&sequence, &PoseRequest::Given(file), &notes).unwrap();
    let said = notes.take().join("|");
    assert!(said.contains("19 of 20 frames have no pose"), "{said}");
    assert!(
        said.contains("from 0.000 s to 1900.000 s, the frames from 0.000 s to 1.900 s"),
        "{said}"
    );
}

/// Poses that count from the first frame of a video whose time stamps begin later are those of other frames.
#[test]
fn poses_from_before_the_video_are_reported() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("late.mp4");
    let mut clip = Clip::steady(256, 128, 20, 10);
    for ticks in &mut clip.ticks {
        *ticks += 30_000;
    }
    clip.write(&video, |frame, x, y| {
        world_colour(1, erp_direction(x, y, 256, 128, 0.02 * frame as f64))
    });
    let settings = CurateSettings {
        enforce: false,
        ..CurateSettings::default()
    };
    curate_video(&video, &temp.path().join("late"), &settings, &Silent).unwrap();
    let sequence = temp.path().join("late/seq-000");
    let posed = |begin: f64| {
        let frames = (0..20).map(f64::from);
        let frames = frames.map(|n| PosedFrame::new(begin + 0.1 * n, pose_at(n)));
        let record = Poses::new(Scale::Metres, None, frames.collect());
        let file = temp.path().join("poses.json");
        store::write_record(&file, &record).unwrap();
        let scene = pose_sequence(&sequence, &PoseRequest::Given(file), &Silent).unwrap();
        let first = scene.frames[0].pose.unwrap().centre[0];
        let mut lines = scene.validation.problems.into_iter();
        (first, lines.find(|line| line.contains("time stamp")))
    };
    assert_eq!(posed(0.5), (0.0, None));
    let (first, line) = posed(0.0);
    assert_eq!(first, 5.0);
    let line = line.unwrap();
    assert!(
        line.contains("start at 0.000 s") && line.contains("0.500 s"),
        "{line}"
    );
}

#[test]
fn poses_of_other_moments_are_reported_with_their_distance() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let line_of = |late: f64| {
        let frames = (0..20).map(f64::from);
        let frames = frames.map(|n| PosedFrame::new(0.1 * n + late, pose_at(n)));
        let record = Poses::new(Scale::Metres, None, frames.collect());
        let file = temp.path().join("poses.json");
        store::write_record(&file, &record).unwrap();
        let scene = pose_sequence(&sequence, &PoseRequest::Given(file), &Silent).unwrap();
        let mut lines = scene.validation.problems.into_iter();
        lines.find(|line| line.contains("of other moments"))
    };
    assert_eq!(line_of(0.001), None);
    let line = line_of(0.04).unwrap();
    assert!(
        line.contains("20 of 20") && line.contains("0.040 s"),
        "{line}"
    );
}
