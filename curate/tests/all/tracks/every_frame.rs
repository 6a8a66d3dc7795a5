//! Tracks through every frame of the video of a scene.

use omnilife_schemas::{
    RgbImage,
    layout::STRAIGHT_FRAMES_FOLDER,
    records::{Sequence, Tracks, VideoProjection},
};
use omnilife_tracks::TracksError;
use omnilife_video::{Converter, Projection, Scaling, VideoReader, ViewVideoWriter};

use super::*;

/// Frames of the video from a sample to the next.
const BETWEEN: usize = 4;

/// Writes a video of a grey that changes from frame to frame.
fn write_video(path: &Path, first: u8) {
    let mut writer = ViewVideoWriter::create(path, [320, 180], Projection::Flat).unwrap();
    let count = (FRAMES - 1) * BETWEEN + 1;
    for number in 0..count {
        let grey = first + (number % 32) as u8;
        let seconds = number as f64 / BETWEEN as f64;
        writer.push(&vec![grey; 320 * 180 * 3], seconds).unwrap();
    }
    writer.finish(count as f64 / BETWEEN as f64).unwrap();
}

/// Makes the frames of the video that the scene samples its images, and returns the times of all.
fn sample_images(video: &Path, scene_folder: &Path) -> Vec<f64> {
    let mut reader = VideoReader::open(video).unwrap();
    let mut converter = Converter::new(Scaling::Native);
    let mut times = Vec::new();
    while let Some(frame) = reader.next_frame().unwrap() {
        if times.len() % BETWEEN == 0 {
            let image = converter.convert(video, &frame.image).unwrap();
            let file = format!("frames/{:06}.png", times.len() / BETWEEN);
            RgbImage::from_rgb8(image.width, image.height, &image.data)
                .write_png(&scene_folder.join(file))
                .unwrap();
        }
        times.push(frame.time_seconds);
    }
    times
}

fn write_sequence(folder: &Path, video: &Path) {
    let mut sequence = Sequence::of_panoramas("flight", [320, 180], Vec::new());
    sequence.source.sha256 = store::sha256_file(video).unwrap();
    sequence.projection.projection = VideoProjection::Rectilinear;
    sequence.range.end_seconds = FRAMES as f64;
    store::write_record(&folder.join("sequence.json"), &sequence).unwrap();
}

/// A scene whose video has four times its frames, and a request for all of them with boxes numbered as in the video.
fn flight(folder: &Path) -> (Scene, TrackRequest) {
    let scene_folder = folder.join("scene");
    let mut scene = write_scene(&scene_folder);
    let video = folder.join("flight.mp4");
    write_video(&video, 80);
    let times = sample_images(&video, &scene_folder);
    assert_eq!(times.len(), (FRAMES - 1) * BETWEEN + 1);
    write_sequence(&scene_folder, &video);
    for (frame, time) in scene.frames.iter_mut().zip(times.iter().step_by(BETWEEN)) {
        frame.time_seconds = *time;
    }
    store::write_record(&scene_folder.join("scene.json"), &scene).unwrap();
    let rotation = scene.frames[0].pose.unwrap().rotation().unwrap();
    let of_video = |seconds: &f64| SceneFrame {
        time_seconds: *seconds,
        pose: Some(Pose::new(rotation, dvec3(0.3 * seconds - 2.0, -4.0, 40.0))),
        ..scene.frames[0].clone()
    };
    let all = Scene {
        frames: times.iter().map(of_video).collect(),
        ..scene.clone()
    };
    let mut request = request(folder, &boxes(&all));
    request.options.video = Some(video);
    (scene, request)
}

fn tracked(request: &TrackRequest) -> Result<Tracks, TracksError> {
    make_tracks(request, &Silent)
}

#[test]
fn tracks_rest_on_every_frame_and_are_told_at_the_samples() {
    let temp = tempfile::tempdir().unwrap();
    let (_, request) = flight(temp.path());
    let tracks = tracked(&request).unwrap();
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    assert_eq!(tracks.frames, (0..FRAMES as u32).collect::<Vec<_>>());
    let is_sample = |frame: u32| (frame as usize) < FRAMES;
    assert!(tracks.detections.iter().all(|one| is_sample(one.frame)));
    assert_eq!(tracks.stages[0].stage, "frames");
    let said = &tracks.stages[0].reason;
    assert!(
        said.starts_with("61 of 61 frames of the video, 16 of them samples"),
        "{said}"
    );
    for track in &tracks.tracks {
        assert!(track.detections as usize > FRAMES, "{}", track.detections);
        let error = (0..2).map(|number| {
            let place = track.path.at(5.3).map(|(place, _)| place);
            let apart = place.map(|place| (place - car(number, 5.3).0).truncate().length());
            apart.unwrap_or(f64::INFINITY)
        });
        let error = error.fold(f64::INFINITY, f64::min);
        assert!(error < 0.5, "{error} m");
    }
    // The images of the video are there while they are needed.
    let left = fs::read_dir(&request.out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let left: Vec<_> = left
        .filter(|name| name.to_string_lossy().contains("video-frames"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

/// Novel views of a split are not usable samples either.
#[test]
fn frames_around_unusable_samples_stay_unseen() {
    let temp = tempfile::tempdir().unwrap();
    let (mut scene, request) = flight(temp.path());
    let odd = scene.frames.iter_mut().skip(1).step_by(2);
    odd.for_each(|frame| frame.pose = None);
    store::write_record(&temp.path().join("scene/scene.json"), &scene).unwrap();
    let tracks = tracked(&request).unwrap();
    let said = &tracks.stages[0].reason;
    // Of eight frames from a usable sample to the next, itself, two after it and one before the next; and the last.
    assert!(
        said.starts_with("29 of 61 frames of the video, 8 of them"),
        "{said}"
    );
    assert_eq!(tracks.frames, [0, 2, 4, 6, 8, 10, 12, 14]);
}

#[test]
fn other_videos_and_shaking_cameras_are_refused_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let (mut scene, request) = flight(temp.path());
    let refusal = |request: &TrackRequest| {
        let error = tracked(request).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User, "{error}");
        let message = error.to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    };
    let mut of_another = request.clone();
    let other = temp.path().join("other.mp4");
    write_video(&other, 120);
    of_another.options.video = Some(other.clone());
    assert!(refusal(&of_another).contains("must be the video of"));
    // The record names it, and its images are others.
    write_sequence(&temp.path().join("scene"), &other);
    assert!(refusal(&of_another).contains("of 255 in the mean"));
    write_sequence(
        &temp.path().join("scene"),
        request.options.video.as_ref().unwrap(),
    );
    let mut by_estimates = request.clone();
    by_estimates.options.distance = DistanceMethod::Monocular;
    assert!(refusal(&by_estimates).contains("--distance monocular"));
    let mut straight = scene.clone();
    straight.frames[3].image = format!("{STRAIGHT_FRAMES_FOLDER}/000003.png");
    store::write_record(&temp.path().join("scene/scene.json"), &straight).unwrap();
    assert!(refusal(&request).contains("the lens is taken out"));
    for (number, frame) in (0..).zip(&mut scene.frames) {
        let turn = DQuat::from_rotation_x(if number % 2 == 0 { 0.02 } else { -0.02 });
        let pose = frame.pose.unwrap();
        frame.pose = Some(Pose::new(pose.rotation().unwrap() * turn, pose.centre()));
    }
    store::write_record(&temp.path().join("scene/scene.json"), &scene).unwrap();
    assert!(refusal(&request).contains("at most 2 may be"));
}
