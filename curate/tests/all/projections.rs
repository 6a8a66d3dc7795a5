//! The ERP projection on images whose projection is known because they are made here.

use omnilife_curate::projection::{TESTS, judge};
use omnilife_schemas::records::{Probe, SphericalMetadata, VideoProjection};
use omnilife_video::Rgb8Image;
use support::{erp_direction, world_colour};

use crate::support;

fn probe(width: u32, height: u32) -> Probe {
    Probe {
        frames_per_second: 30.0,
        duration_seconds: 10.0,
        ..Probe::of_size([width, height])
    }
}

fn paint(width: usize, height: usize, colour: impl Fn(usize, usize) -> [f64; 3]) -> Rgb8Image {
    let mut data = Vec::new();
    for y in 0..height {
        for x in 0..width {
            data.extend(colour(x, y).map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    Rgb8Image::new(width, height, data)
}

/// A world with structure at all scales, so that stereo has details to match.
fn rich(world: usize, d: [f64; 3]) -> [f64; 3] {
    let fine = (37.0 * d[0] + 5.0 * d[1]).sin() * (41.0 * d[2] - 3.0 * d[1]).cos() * 0.3;
    world_colour(world, d).map(|level| level + fine)
}

fn erp(world: usize, width: usize, height: usize, yaw: f64) -> Rgb8Image {
    paint(width, height, |x, y| {
        rich(world, erp_direction(x, y, width, height, yaw))
    })
}

fn perspective(world: usize, width: usize, height: usize) -> Rgb8Image {
    paint(width, height, |x, y| {
        let u = (x as f64 + 0.5) / width as f64 - 0.5;
        let v = ((y as f64 + 0.5) - 0.5 * height as f64) / width as f64;
        let length = (u * u + v * v + 0.25).sqrt();
        rich(world, [u / length, v / length, 0.5 / length])
    })
}

/// Two images in one, the second seen with a little yaw instead of a disparity.
fn stacked(world: usize, width: usize, height: usize, beside: bool) -> Rgb8Image {
    let (w, h) = if beside {
        (width / 2, height)
    } else {
        (width, height / 2)
    };
    let left = erp(world, w, h, 0.0);
    let right = erp(world, w, h, 0.03);
    paint(width, height, |x, y| {
        let image = if x < w && y < h { &left } else { &right };
        image.pixel(x % w, y % h).map(|v| f64::from(v) / 255.0)
    })
}

/// A frame that shows the world with this number.
type Painter = fn(usize) -> Rgb8Image;

#[test]
fn known_projections_are_recognized() {
    let cases: [(&str, VideoProjection, (u32, u32), Painter); 6] = [
        ("erp", VideoProjection::Erp, (3840, 1920), |w| {
            erp(w, 512, 256, 0.7 * w as f64)
        }),
        (
            "squeezed",
            VideoProjection::ErpSqueezed,
            (1920, 1080),
            |w| erp(w, 512, 288, 0.7 * w as f64),
        ),
        (
            "rectilinear",
            VideoProjection::Rectilinear,
            (1920, 1080),
            |w| perspective(w, 512, 288),
        ),
        (
            "rectilinear 2:1",
            VideoProjection::Rectilinear,
            (1920, 960),
            |w| perspective(w, 512, 256),
        ),
        (
            "top-bottom",
            VideoProjection::ErpStereoTb,
            (3840, 3840),
            |w| stacked(w, 512, 512, false),
        ),
        (
            "side by side",
            VideoProjection::ErpStereoLr,
            (3840, 960),
            |w| stacked(w, 1024, 256, true),
        ),
    ];
    for (name, expected, (width, height), image) in cases {
        for world in 0..6 {
            let projection = judge(&probe(width, height), &[image(world)]);
            assert_eq!(
                projection.projection, expected,
                "{name}, world {world}: {:#?}",
                projection.evidence
            );
        }
    }
}

/// Undecidable projections are not guessed.
#[test]
fn plain_pillarboxed_and_missing_images_are_unsure() {
    let grey = paint(512, 256, |_, _| [0.5; 3]);
    let boxed = paint(512, 256, |x, y| {
        if (128..384).contains(&x) {
            rich(1, erp_direction(x - 128, y, 256, 256, 0.0))
        } else {
            [0.0; 3]
        }
    });
    for samples in [vec![], vec![grey], vec![boxed]] {
        let projection = judge(&probe(1920, 960), &samples);
        assert_eq!(
            projection.projection,
            VideoProjection::Unsure,
            "{:#?}",
            projection.evidence
        );
    }
}

#[test]
fn metadata_is_heard_and_contradicted() {
    let stated = |projection: &str, stereo: Option<&str>| Probe {
        spherical: Some(SphericalMetadata {
            is_right_eye_first: false,
            projection: projection.to_owned(),
            stereo: stereo.map(str::to_owned),
            is_cropped: false,
            is_front_half: false,
            pose: None,
            initial_view: None,
            turn_fault: None,
            origin: "v2".to_owned(),
            conflict: None,
        }),
        ..probe(1920, 960)
    };
    let grey = [paint(512, 256, |_, _| [0.5; 3])];
    let undecided = judge(&stated("equirectangular", Some("2D")), &grey);
    assert_eq!(undecided.projection, VideoProjection::Erp);
    assert!(undecided.disagreement.unwrap().contains("do not decide"));

    let image = [perspective(2, 512, 256)];
    let contradicted = judge(&stated("equirectangular", Some("2D")), &image);
    assert_eq!(contradicted.projection, VideoProjection::Rectilinear);
    assert!(contradicted.disagreement.unwrap().contains("rectilinear"));

    let sphere = [erp(2, 512, 256, 0.0)];
    let agreed = judge(&stated("equirectangular", None), &sphere);
    assert_eq!(
        (agreed.projection, agreed.disagreement),
        (VideoProjection::Erp, None)
    );
    let layout = judge(&stated("equirectangular", Some("top and bottom")), &sphere);
    assert_eq!(layout.projection, VideoProjection::Erp);
    assert!(layout.disagreement.unwrap().contains("top and bottom"));
}

/// Golden values on one image; the seam of an ERP is as smooth as its inside.
#[test]
fn measurements_of_a_known_image() {
    let sphere = [erp(3, 512, 256, 0.4)];
    let flat = [perspective(3, 512, 256)];
    let value = |id: &str, samples: &[Rgb8Image]| {
        let test = TESTS.iter().find(|test| test.id == id).unwrap();
        (test.measure)(&probe(2048, 1024), samples).unwrap()
    };
    assert_eq!(value("aspect-ratio", &sphere), 0.0);
    assert!(value("wrap-seam", &sphere) < 0.02);
    assert!(value("wrap-seam", &flat) > 0.5);
    assert!(value("pole-row-top", &sphere) < 0.2);
    assert!(value("pole-row-bottom", &flat) > 0.5);
    assert_eq!(value("black-sides", &sphere), 0.0);
}
