//! Videos that store the sphere otherwise, as `FFmpeg`'s filter `v360` makes them of an equirectangular one: their
//! frames are those of the original, at least as nearly as `v360` itself brings them back.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use glam::{DQuat, DVec3};
use omnilife_curate::{
    CurateSettings, LayoutChoice, PoseRequest, curate_video, poses::pose_sequence,
};
use omnilife_schemas::{
    Pose, RgbImage,
    layout::SEQUENCE_FILE,
    progress::Silent,
    records::{PosedFrame, Poses, Scale, Sequence, Slices, SphereLayout, VideoProjection},
    rgb::Mask,
    store,
    testing::Notes,
    testing::skip,
};
use omnilife_video::{Orientation, probe, writing::spherical_boxes::mark_equirectangular};
use support::{Clip, erp_direction, world_colour};

use crate::support;

const SIZE: [usize; 2] = [512, 256];
const WIDTH: u32 = 256;

/// A walk through a world with structure of a few pixels, everywhere on the sphere.
fn original(folder: &Path) -> PathBuf {
    let path = folder.join("erp.mp4");
    Clip::steady(SIZE[0], SIZE[1], 8, 8).write(&path, |frame, x, y| {
        let d = erp_direction(x, y, SIZE[0], SIZE[1], 0.05 * frame as f64);
        let fine = (23.0 * d[0] + 5.0 * d[1]).sin() * (19.0 * d[2] - 7.0 * d[1]).cos() * 0.25;
        world_colour(1, d).map(|level| level + fine)
    });
    path
}

/// Runs a video through a filter, nearly without loss; whether this `FFmpeg` can.
fn filtered(from: &Path, filter: &str, to: &Path) -> bool {
    let status = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-i"])
        .arg(from)
        .args([
            "-vf", filter, "-c:v", "libx264", "-qp", "4", "-pix_fmt", "yuv444p",
        ])
        .arg(to)
        .status();
    status.is_ok_and(|status| status.success())
}

fn frames(video: &Path, layout: Option<LayoutChoice>, notes: &Notes) -> (Vec<RgbImage>, Sequence) {
    let folder = video.with_extension("");
    let settings = CurateSettings {
        enforce: false,
        layout,
        width: Some(WIDTH),
        minimum_shot_seconds: 0.0,
        ..CurateSettings::default()
    };
    let names = curate_video(video, &folder, &settings, notes).unwrap();
    let folder = folder.join(&names[0]);
    let sequence: Sequence = store::read_record(&folder.join(SEQUENCE_FILE)).unwrap();
    let read = |file: &str| RgbImage::read(&folder.join(file)).unwrap();
    let images = sequence
        .frames
        .entries
        .iter()
        .map(|entry| read(&entry.file));
    (images.collect(), sequence)
}

fn psnr(a: &[RgbImage], b: &[RgbImage]) -> f64 {
    assert_eq!(a.len(), b.len());
    let errors = a.iter().zip(b).flat_map(|(a, b)| {
        assert_eq!((a.width, a.height), (b.width, b.height));
        a.data
            .iter()
            .zip(&b.data)
            .map(|(a, b)| f64::from(a - b).powi(2))
    });
    let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error, count + 1.0));
    -10.0 * (sum / count).log10()
}

#[test]
fn frames_of_every_layout_are_those_of_the_original() {
    let temp = tempfile::tempdir().unwrap();
    let erp = original(temp.path());
    let (truth, _) = frames(&erp, None, &Notes::default());
    // Name of the layout, and v360's name, options and size: of more than 576 rows another matrix would be assumed.
    let cases = [
        ("eac", "eac", "", [384, 256]),
        ("cubemap-3x2", "c3x2", "", [384, 256]),
        (
            "cubemap-6x1:frblud",
            "c6x1",
            ":out_forder=frblud",
            [768, 128],
        ),
        ("cubemap-1x6", "c1x6", "", [96, 576]),
        (
            "dual-fisheye:200",
            "dfisheye",
            ":h_fov=200:v_fov=200",
            [512, 256],
        ),
    ];
    for (name, kind, options, [width, height]) in cases {
        let layout: SphereLayout = name.parse().unwrap();
        let file = |suffix: &str| temp.path().join(format!("{kind}{suffix}.mp4"));
        let (stored, back) = (file(""), file("-back"));
        let there = format!("v360=e:{kind}{options}:w={width}:h={height}:interp=cubic");
        if !filtered(&erp, &there, &stored) {
            skip("FFmpeg with its filter v360 and libx264 is missing");
            return;
        }
        let options = options
            .replace("out_forder", "in_forder")
            .replace(":h_", ":ih_")
            .replace(":v_", ":iv_");
        let size = format!("w={}:h={}", SIZE[0], SIZE[1]);
        assert!(filtered(
            &stored,
            &format!("v360={kind}:e{options}:{size}:interp=line"),
            &back
        ));
        let (found, sequence) = frames(
            &stored,
            Some(LayoutChoice::Known(layout)),
            &Notes::default(),
        );
        let (peer, _) = frames(&back, None, &Notes::default());
        let [ours, peers] = [&found, &peer].map(|images| psnr(images, &truth));
        println!("{name}: {ours:.2} dB, back by v360 {peers:.2} dB");
        assert!(
            ours > peers - 0.3 && ours > 30.0,
            "{name}: {ours:.2} dB, v360 {peers:.2} dB"
        );
        assert_eq!(sequence.frames.converted_from, Some(layout));
        assert!(
            !sequence.projection.projection.is_monoscopic_erp(),
            "{name}"
        );
        assert_eq!(
            (sequence.frames.width, sequence.frames.height),
            (WIDTH, WIDTH / 2)
        );
    }
}

/// The order of faces that Spherical Video V2 defines is that of `v360`.
#[test]
fn cube_faces_that_the_container_states_need_no_option() {
    let temp = tempfile::tempdir().unwrap();
    let erp = original(temp.path());
    let (truth, _) = frames(&erp, None, &Notes::default());
    let file = |name: &str| temp.path().join(name);
    let stored = file("cube.mp4");
    if !filtered(&erp, "v360=e:c3x2:w=384:h=256:interp=cubic", &stored) {
        skip("FFmpeg with its filter v360 and libx264 is missing");
        return;
    }
    mark_equirectangular(&stored, Orientation::default()).unwrap();
    let mut bytes = fs::read(&stored).unwrap();
    // A box of another name: version and flags, layout and padding are 0.
    let at = bytes.windows(4).position(|word| word == b"equi").unwrap();
    bytes[at..at + 4].copy_from_slice(b"cbmp");
    for name in ["cube.mp4", "taken-as-eac.mp4"] {
        fs::write(file(name), &bytes).unwrap();
    }
    let notes = Notes::default();
    let (found, sequence) = frames(&stored, None, &notes);
    let layout: SphereLayout = "cubemap-3x2".parse().unwrap();
    assert_eq!(sequence.frames.converted_from, Some(layout));
    let ours = psnr(&found, &truth);
    assert!(ours > 30.0, "{ours:.2} dB");
    let is_told = |notes: &Notes| notes.take().join("|").contains("container states");
    assert!(!is_told(&notes));
    let eac = LayoutChoice::Known(SphereLayout::EquiangularCubemap);
    frames(&file("taken-as-eac.mp4"), Some(eac), &notes);
    assert!(is_told(&notes));
    let projection = |video: &Path| probe(video).unwrap().spherical.unwrap().projection;
    assert_eq!(projection(&stored), "cubemap");
    // A padding of eight pixels, and a layout that is not defined.
    for place in [15, 11] {
        let mut changed = bytes.clone();
        changed[at + place] = 8;
        fs::write(file("changed.mp4"), changed).unwrap();
        assert_ne!(projection(&file("changed.mp4")), "cubemap");
    }
}

#[test]
fn stereo_is_seen_and_its_left_eye_taken() {
    let temp = tempfile::tempdir().unwrap();
    let erp = original(temp.path());
    let (truth, _) = frames(&erp, None, &Notes::default());
    let stored = temp.path().join("stereo.mp4");
    // The right eye sees the world turned by a few pixels.
    let beside = "split[l][r];[r]scroll=hpos=0.01[t];[l][t]vstack";
    if !filtered(&erp, beside, &stored) {
        skip("FFmpeg with libx264 is missing");
        return;
    }
    let notes = Notes::default();
    let (found, sequence) = frames(&stored, None, &notes);
    assert!(
        psnr(&found, &truth) > 35.0,
        "{:.2} dB",
        psnr(&found, &truth)
    );
    assert_eq!(sequence.projection.projection, VideoProjection::ErpStereoTb);
    assert_eq!(
        sequence.frames.converted_from,
        Some(SphereLayout::StereoTopBottom)
    );
    let told = notes.take().join("\n");
    assert!(
        told.contains("made equirectangular from stereo-top-bottom, by the evidence"),
        "{told}"
    );
}

/// VR180: one eye is converted, and the rear of its scene is neither trained on nor scored.
#[test]
fn half_of_a_sphere_becomes_a_scene_that_ignores_the_rest() {
    let temp = tempfile::tempdir().unwrap();
    let erp = original(temp.path());
    let (truth, _) = frames(&erp, None, &Notes::default());
    let stored = temp.path().join("vr180.mp4");
    let beside = "v360=e:hequirect:w=256:h=256:interp=cubic,split[l][r];\
                  [r]scroll=hpos=0.02[t];[l][t]hstack";
    if !filtered(&erp, beside, &stored) {
        skip("FFmpeg with its filter v360 and libx264 is missing");
        return;
    }
    let layout = SphereLayout::HalfErpLeftRight;
    let (found, sequence) = frames(
        &stored,
        Some(LayoutChoice::Known(layout)),
        &Notes::default(),
    );
    let quarter = WIDTH as usize / 4;
    let ahead = |images: &[RgbImage]| -> Vec<RgbImage> {
        let halves = images.iter().map(|image| RgbImage {
            width: 2 * quarter,
            height: image.height,
            data: (image.data.chunks_exact(3 * image.width))
                .flat_map(|row| row[3 * quarter..9 * quarter].to_vec())
                .collect(),
        });
        halves.collect()
    };
    let psnr = psnr(&ahead(&found), &ahead(&truth));
    println!("{layout}: {psnr:.2} dB");
    assert!(psnr > 35.0, "{psnr:.2} dB");
    assert_eq!(sequence.projection.projection, VideoProjection::HalfErp);

    let frames = sequence.frames.entries.iter().map(|entry| {
        PosedFrame::new(
            entry.time_seconds,
            Pose::new(DQuat::IDENTITY, DVec3::X * entry.time_seconds),
        )
    });
    let poses = Poses::new(Scale::Arbitrary, None, frames.collect());
    let file = temp.path().join("poses.json");
    store::write_record(&file, &poses).unwrap();
    let folder = stored
        .with_extension("")
        .join(sequence.id.rsplit('/').next().unwrap());
    let scene = pose_sequence(&folder, &PoseRequest::Given(file), &Silent).unwrap();
    for frame in &scene.frames {
        let mask = Mask::read(&folder.join(frame.ignore_mask.as_ref().unwrap())).unwrap();
        let is_ahead = |pixel: usize| (quarter..3 * quarter).contains(&(pixel % mask.width));
        assert!((0..mask.data.len()).all(|pixel| (mask.data[pixel] == 0) == is_ahead(pixel)));
    }
}

#[test]
fn unknown_lenses_are_found() {
    let temp = tempfile::tempdir().unwrap();
    let erp = original(temp.path());
    let (truth, _) = frames(&erp, None, &Notes::default());
    let stored = temp.path().join("two-lenses.mp4");
    let there = "v360=e:dfisheye:h_fov=204:v_fov=204:w=1024:h=512:interp=cubic";
    if !filtered(&erp, there, &stored) {
        skip("FFmpeg with its filter v360 and libx264 is missing");
        return;
    }
    let notes = Notes::default();
    let choice: LayoutChoice = "dual-fisheye".parse().unwrap();
    let (found, sequence) = frames(&stored, Some(choice), &notes);
    let told = notes.take().join("\n");
    println!("{told}; {:.2} dB", psnr(&found, &truth));
    assert!(
        told.contains("its lenses are taken for dual-fisheye:20"),
        "{told}"
    );
    assert!(
        psnr(&found, &truth) > 30.0,
        "{:.2} dB",
        psnr(&found, &truth)
    );
    let Some(SphereLayout::DualFisheye {
        field_of_view_degrees,
        ..
    }) = sequence.frames.converted_from
    else {
        panic!("{:?}", sequence.frames.converted_from);
    };
    assert!(
        (field_of_view_degrees - 204.0).abs() < 1.5,
        "{field_of_view_degrees}"
    );
    // Halves that have nothing in common are not those of two lenses.
    let other = temp.path().join("other.mp4");
    Clip::steady(512, 256, 8, 8).write(&other, |frame, x, y| {
        let direction = erp_direction(x, y, 512, 256, 0.05 * frame as f64);
        world_colour(if x < 256 { 1 } else { 4 }, direction)
    });
    let settings = CurateSettings {
        enforce: false,
        layout: Some(choice),
        ..CurateSettings::default()
    };
    let refused = curate_video(&other, &temp.path().join("out"), &settings, &Silent).unwrap_err();
    assert!(
        refused.to_string().contains("no field of view"),
        "{refused}"
    );
}

#[test]
fn what_is_converted_is_kept_without_the_slices_that_it_cannot_have() {
    let temp = tempfile::tempdir().unwrap();
    let video = temp.path().join("eyes.mp4");
    Clip::steady(256, 256, 8, 8).write(&video, |frame, x, y| {
        let direction = erp_direction(x, y % 128, 256, 128, 0.05 * frame as f64);
        world_colour(1, direction)
    });
    let settings = CurateSettings {
        enforce: false,
        layout: Some("stereo-top-bottom".parse().unwrap()),
        minimum_shot_seconds: 0.0,
        slices: Some(omnilife_curate::slicing::SliceSettings { audio: false }),
        ..CurateSettings::default()
    };
    let (out, notes) = (temp.path().join("out"), Notes::default());
    let names = curate_video(&video, &out, &settings, &notes).unwrap();
    assert!(!names.is_empty());
    let said = notes.take();
    assert!(
        said.iter().any(|line| line.contains("has no slices")),
        "{said:?}"
    );
    let record: Slices = store::read_record(&out.join("slices.json")).unwrap();
    assert!(record.no_slices.is_some() && !out.join("slices").exists());
    // Where none are asked for nothing is missing.
    let settings = CurateSettings {
        slices: None,
        ..settings
    };
    curate_video(&video, &out, &settings, &Silent).unwrap();
    let record: Slices = store::read_record(&out.join("slices.json")).unwrap();
    assert_eq!(record.no_slices, None);
}

#[test]
fn videos_too_low_to_store_a_sphere_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let low = temp.path().join("low.mp4");
    Clip::steady(64, 8, 4, 8).write(&low, |_, _, _| [0.5; 3]);
    for name in SphereLayout::NAMES {
        let settings = CurateSettings {
            enforce: false,
            layout: Some(name.parse().unwrap()),
            ..CurateSettings::default()
        };
        let refused = curate_video(&low, &temp.path().join(name), &settings, &Silent).unwrap_err();
        assert!(
            refused
                .to_string()
                .contains("8 rows of pixels store no sphere as"),
            "{name}: {refused}"
        );
    }
}

/// Frames of a flat clip, of a sphere and of a strip, each stated to be what has another shape.
#[test]
fn layouts_that_do_not_fit_the_shape_of_the_frames_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    for ([width, height], layouts) in [
        (
            [128, 72],
            ["cubemap-6x1", "half-erp", "cubemap-1x6"].as_slice(),
        ),
        (
            [128, 64],
            &["cubemap-3x2", "half-erp-top-bottom", "cubemap-1x6"],
        ),
        ([64, 128], &["stereo-left-right", "half-erp", "eac"]),
    ] {
        let video = temp.path().join(format!("{width}x{height}.mp4"));
        Clip::steady(width, height, 4, 8).write(&video, |_, _, _| [0.5; 3]);
        for name in layouts {
            let settings = CurateSettings {
                enforce: false,
                layout: Some(name.parse().unwrap()),
                ..CurateSettings::default()
            };
            let out = temp.path().join(name);
            let refused = curate_video(&video, &out, &settings, &Silent).unwrap_err();
            let text = refused.to_string();
            assert!(
                text.contains(&format!("{width}x{height}")),
                "{name}: {text}"
            );
            assert!(!out.exists(), "{name}");
        }
    }
}
