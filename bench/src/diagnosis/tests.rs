//! Findings in synthetic panoramas, and views without any.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

use super::{
    border, colour,
    copies::{self, Look, Truth, Truths},
    encoding::Encoding,
    geometry,
    images::reduced,
    kind::{ChannelOrder, DiagnosisKind},
    look::ViewFacts,
    order::{Comparison, FrameOrder},
    shifts,
};
use crate::{
    job::{View, ViewKind},
    metrics::ViewPair,
};

const WIDTH: usize = 256;
const HEIGHT: usize = 128;
const SIZE: [usize; 2] = [WIDTH, HEIGHT];
const FRAMES: u32 = 31;
const NOVEL: [u32; 6] = [4, 9, 14, 19, 24, 29];

fn given() -> Vec<u32> {
    (0..FRAMES).filter(|frame| !NOVEL.contains(frame)).collect()
}

/// Returns a number in [0, 1) of three others.
fn scattered(i: u32, j: u32, seed: u32) -> f64 {
    let mut hash =
        i.wrapping_mul(0x9E37_79B1) ^ j.wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    hash ^= hash >> 15;
    hash = hash.wrapping_mul(0x2C1B_3C6D);
    hash ^= hash >> 12;
    hash = hash.wrapping_mul(0x297A_2D39);
    hash ^= hash >> 15;
    f64::from(hash) / 4_294_967_296.0
}

/// Returns smooth noise in [0, 1] of a place in [0, 1) x [0, 1): random values in `cells` cells of the longitude, which
/// wraps, and half as many of the latitude.
fn noise(x: f64, y: f64, cells: u32, seed: u32) -> f64 {
    let (x, y) = (x * f64::from(cells), 0.5 * y * f64::from(cells));
    let (i, j) = (x as u32, y as u32);
    let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
    let (a, b) = (smooth(x.fract()), smooth(y.fract()));
    let row = |j: u32| {
        (1.0 - a) * scattered(i % cells, j, seed) + a * scattered((i + 1) % cells, j, seed)
    };
    (1.0 - b) * row(j) + b * row(j + 1)
}

fn byte(value: f64) -> u8 {
    (value + 0.5).floor().clamp(0.0, 255.0) as u8
}

/// Bytes of an image whose pixels are a function of column and row.
fn image(pixel: impl Fn(usize, usize) -> [f64; 3]) -> Vec<u8> {
    let pixels = (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column, row)));
    pixels
        .flat_map(|(column, row)| pixel(column, row).map(byte))
        .collect()
}

/// Returns ground and sky in the view of a walking camera: near content moves more.
fn panorama(frame: u32) -> Vec<u8> {
    image(|column, row| {
        let y = (row as f64 + 0.5) / HEIGHT as f64;
        let longitude = (column as f64 + 0.5) / WIDTH as f64;
        let walked = 0.012 * f64::from(frame) * (std::f64::consts::TAU * longitude).sin();
        let x = (longitude + walked * y).rem_euclid(1.0);
        let octaves = [(0.5, 8, 1), (0.4, 16, 2), (0.3, 32, 3), (0.2, 64, 4)];
        let texture: f64 = octaves
            .iter()
            .map(|&(weight, cells, seed)| weight * (noise(x, y, cells, seed) - 0.5))
            .sum();
        let is_sky = y < 0.45;
        let grey = if is_sky {
            0.7 + 0.6 * texture
        } else {
            0.35 + texture
        };
        let [red, green] = [noise(x, y, 12, 5) - 0.5, noise(x, y, 10, 6) - 0.5];
        let blue = if is_sky { 0.1 } else { -0.05 };
        let pixel = [
            grey + 0.3 * red,
            grey + 0.2 * green,
            grey - 0.3 * red - 0.1 * green + blue,
        ];
        pixel.map(|value| 255.0 * value)
    })
}

/// Returns a frame as a trained model renders it: blurred, noisy and of uneven colour, 32 dB.
fn rendered(frame: u32) -> Vec<u8> {
    let truth = panorama(frame);
    image(|column, row| {
        let unevenness = noise(
            (column as f64 + 0.5) / WIDTH as f64,
            (row as f64 + 0.5) / HEIGHT as f64,
            4,
            frame,
        );
        [0, 1, 2].map(|channel| {
            let rows = [row.saturating_sub(1), row, (row + 1).min(HEIGHT - 1)];
            let columns = [WIDTH - 1, 0, 1].map(|step| (column + step) % WIDTH);
            let at =
                |row: usize, column: usize| f64::from(truth[3 * (row * WIDTH + column) + channel]);
            let sum: f64 = rows
                .iter()
                .flat_map(|&row| columns.map(|column| at(row, column)))
                .sum();
            let value = (3 * (row * WIDTH + column) + channel) as u32;
            let random = scattered(value, frame, 9) - 0.5;
            sum / 9.0 + 12.0 * random + 12.0 * (unevenness - 0.5)
        })
    })
}

/// Changes every value of an image, with its channel.
fn with_values(image: &[u8], change: impl Fn(f64, usize) -> f64) -> Vec<u8> {
    let values = image.iter().enumerate();
    values
        .map(|(at, &value)| byte(change(f64::from(value), at % 3)))
        .collect()
}

/// Takes every pixel from another place; columns wrap, rows end.
fn from_places(image: &[u8], place: impl Fn(i64, i64) -> [i64; 2]) -> Vec<u8> {
    let mut out = Vec::with_capacity(image.len());
    for row in 0..HEIGHT as i64 {
        for column in 0..WIDTH as i64 {
            let [column, row] = place(column, row);
            let column = column.rem_euclid(WIDTH as i64) as usize;
            let row = row.clamp(0, HEIGHT as i64 - 1) as usize;
            out.extend_from_slice(&image[3 * (row * WIDTH + column)..][..3]);
        }
    }
    out
}

fn looked(predict: impl Fn(u32) -> Vec<u8>) -> Vec<ViewFacts> {
    let look = |frame: u32| {
        let pair = ViewPair::new(WIDTH, HEIGHT, predict(frame), panorama(frame)).unwrap();
        let view = View {
            kind: ViewKind::Novel,
            frame,
        };
        ViewFacts::of(view, &pair, true)
    };
    NOVEL.into_iter().map(look).collect()
}

fn truths() -> Truths {
    (0..FRAMES)
        .map(|frame| (frame, truth(&panorama(frame))))
        .collect()
}

fn truth(bytes: &[u8]) -> Truth {
    Truth {
        medium: reduced(bytes, SIZE, 256).1,
        look: Look::of(bytes, SIZE),
    }
}

fn order(views: &[ViewFacts], truths: &Truths) -> Option<FrameOrder> {
    let comparison = Comparison::new(views, &NOVEL, truths);
    comparison.order().map(|(order, _)| order)
}

/// Findings of each family, in words; empty without any.
fn found(views: &[ViewFacts]) -> Vec<String> {
    let mut found = Vec::new();
    found.extend(geometry::turn(views, true).map(|found| format!("{found:?}")));
    found.extend(shifts::common(views).map(|found| format!("{found:?}")));
    found.extend(colour::channels(views).map(|found| format!("{found:?}")));
    found.extend(colour::encoding(views).map(|found| format!("{found:?}")));
    found
}

#[test]
fn honest_views_have_no_finding() {
    let scaled = |gains: [f64; 3], offset: f64| {
        move |frame: u32| {
            with_values(&rendered(frame), |value, channel| {
                gains[channel] * value + offset
            })
        }
    };
    let mean_of_sides = |frame: u32| {
        let sides = [panorama(frame - 1), panorama(frame + 1)];
        let values = sides[0].iter().zip(&sides[1]);
        let mean = |(&a, &b): (&u8, &u8)| byte(0.5 * (f64::from(a) + f64::from(b)));
        values.map(mean).collect::<Vec<u8>>()
    };
    let grey = |frame: u32| {
        let image = rendered(frame);
        let pixels = image.as_chunks::<3>().0.iter();
        pixels.flat_map(|pixel| [pixel[1]; 3]).collect::<Vec<u8>>()
    };
    let cases: [(&str, Vec<ViewFacts>); 8] = [
        ("rendered", looked(rendered)),
        ("truth", looked(panorama)),
        ("dark", looked(scaled([0.85; 3], 0.0))),
        ("raised", looked(scaled([1.0; 3], 15.0))),
        ("flat", looked(scaled([0.8; 3], 25.0))),
        ("tinted", looked(scaled([1.12, 1.0, 0.88], 0.0))),
        ("grey", looked(grey)),
        ("between its sides", looked(mean_of_sides)),
    ];
    let truths = truths();
    for (name, views) in &cases {
        assert_eq!(found(views), [""; 0], "{name}");
        assert_eq!(order(views, &truths), None, "{name}");
        assert!(!copies::is_one_image(views), "{name}");
        assert!(!views.iter().any(|view| view.is_doubled), "{name}");
        assert_eq!(border::common(views), None, "{name}");
    }
}

#[test]
fn turns_and_mirrored_axes_are_found_with_their_angle() {
    let last = [WIDTH as i64 - 1, HEIGHT as i64 - 1];
    // Of the views: mirrored, upside down, columns that they lie too far on the right.
    for (is_mirrored, is_upside_down, columns) in [
        (true, false, 0),
        (false, true, 0),
        (true, true, 0),
        (false, false, 64),
        (false, false, 128),
        (false, false, -37),
        (false, false, 11),
        (true, false, 90),
    ] {
        let views = looked(|frame| {
            from_places(&rendered(frame), |column, row| {
                let column = column - columns;
                [
                    if is_mirrored {
                        last[0] - column
                    } else {
                        column
                    },
                    if is_upside_down { last[1] - row } else { row },
                ]
            })
        });
        let (turn, gain) = geometry::turn(&views, true).unwrap();
        assert_eq!(
            (turn.is_mirrored, turn.is_upside_down),
            (is_mirrored, is_upside_down)
        );
        // A mirrored view that was moved to the right is moved to the right once more.
        let columns = if is_mirrored { columns } else { -columns };
        let apart = turn.degrees_right - columns as f64 * 360.0 / WIDTH as f64;
        assert!(
            apart.abs().min(360.0 - apart.abs()) < 0.5,
            "{columns}: {turn:?}"
        );
        assert!(gain > 5.0, "{gain}");
        assert!(!turn.is_small(), "{turn:?}");
    }
}

#[test]
fn whole_and_half_pixels_are_found_and_a_walking_camera_is_not() {
    for [right, down] in [[2, 0], [-4, 0], [0, 2], [1, 0], [-1, -1], [0, -1]] {
        let shifted = |frame| {
            let image = rendered(frame);
            let near = from_places(&image, |column, row| {
                [column - (right >> 1), row - (down >> 1)]
            });
            let far = from_places(&image, |column, row| {
                [column - ((right + 1) >> 1), row - ((down + 1) >> 1)]
            });
            let values = near.iter().zip(&far);
            let mean = |(&a, &b): (&u8, &u8)| byte(0.5 * (f64::from(a) + f64::from(b)));
            values.map(mean).collect::<Vec<u8>>()
        };
        let found = shifts::common(&looked(shifted)).unwrap();
        assert_eq!(found.map(i64::from), [right, down]);
        let pair = ViewPair::new(WIDTH, HEIGHT, shifted(9), panorama(9)).unwrap();
        let gain = shifts::gain_db(&pair, found);
        assert!(gain > 0.2, "{right} {down}: {gain}");
        assert_eq!(shifts::telling_gain(&[gain, gain]), Some(gain));
        assert_eq!(shifts::telling_gain(&[gain, 0.1]), None);
    }
    assert_eq!(shifts::common(&looked(|frame| rendered(frame + 1))), None);
    assert_eq!(shifts::common(&looked(|frame| rendered(frame - 1))), None);
}

#[test]
fn every_order_of_channels_is_found() {
    for stored in ChannelOrder::ALL {
        let views = looked(|frame| {
            let mut image = rendered(frame);
            for pixel in image.as_chunks_mut::<3>().0 {
                let right = *pixel;
                for (value, place) in right.into_iter().zip(stored.places()) {
                    pixel[place] = value;
                }
            }
            image
        });
        let (found, gain) = colour::channels(&views).unwrap();
        assert_eq!(found, stored);
        assert!(gain > 1.0, "{gain}");
        assert_eq!(colour::encoding(&views), None);
    }
}

#[test]
fn every_encoding_is_found_and_named() {
    for made in Encoding::ALL {
        let views = looked(|frame| {
            let image = rendered(frame);
            let pixels = image.as_chunks::<3>().0.iter();
            let encoded = pixels.flat_map(|pixel| {
                made.encoded(pixel.map(|value| f64::from(value) / 255.0))
                    .map(|value| byte(255.0 * value))
            });
            encoded.collect()
        });
        let (found, _) = colour::encoding(&views).unwrap();
        let alike = match made {
            // A power of 2.2 is hardly another curve than that of sRGB.
            Encoding::Linear | Encoding::Gamma => [Encoding::Linear, Encoding::Gamma],
            Encoding::SrgbTwice | Encoding::InverseGamma => {
                [Encoding::SrgbTwice, Encoding::InverseGamma]
            }
            _ => [made; 2],
        };
        assert!(alike.contains(&found), "{made:?}: {found:?}");
        assert_eq!(colour::channels(&views), None, "{made:?}");
    }
}

#[test]
fn what_an_encoding_does_is_undone_where_nothing_was_cut() {
    for encoding in Encoding::ALL {
        let pixel = [0.55, 0.6, 0.65];
        let encoded = encoding.encoded(pixel);
        if encoded.iter().all(|&value| value > 0.0 && value < 1.0) {
            let decoded = encoding.decoded(encoded);
            for (value, decoded) in pixel.iter().zip(decoded) {
                assert!((value - decoded).abs() < 1e-4, "{encoding:?}");
            }
        }
    }
    // The transfer function of sRGB at middle grey: IEC 61966-2-1 gives 0.2140 for 0.5.
    let [linear, ..] = Encoding::Linear.encoded([0.5; 3]);
    assert!((linear - 0.2140).abs() < 1e-4, "{linear}");
    assert_eq!(
        Encoding::LimitedRange.encoded([0.0, 1.0, 0.0])[1],
        235.0 / 255.0
    );
}

#[test]
fn other_frames_are_found_by_their_order() {
    let truths = truths();
    let place = |frame: u32| NOVEL.iter().position(|&other| other == frame).unwrap();
    let shown = |frames: [u32; 6]| looked(move |frame| rendered(frames[place(frame)]));
    for (frames, expected) in [
        ([9, 14, 19, 24, 29, 29], FrameOrder::PlacesOn(1)),
        ([4, 4, 9, 14, 19, 24], FrameOrder::PlacesOn(-1)),
        ([29, 24, 19, 14, 9, 4], FrameOrder::Reversed),
        ([5, 10, 15, 20, 25, 30], FrameOrder::FramesOn(1)),
        ([3, 8, 13, 18, 23, 28], FrameOrder::FramesOn(-1)),
        ([14, 29, 4, 24, 9, 19], FrameOrder::Permuted),
    ] {
        assert_eq!(order(&shown(frames), &truths), Some(expected), "{frames:?}");
    }
    // One view in a wrong place does not make an order.
    assert_eq!(order(&shown([9, 9, 14, 19, 24, 29]), &truths), None);
}

#[test]
fn a_still_camera_has_no_order() {
    let truths: Truths = (0..FRAMES)
        .map(|frame| (frame, truth(&panorama(7))))
        .collect();
    let views: Vec<ViewFacts> = NOVEL
        .into_iter()
        .map(|frame| {
            let pair = ViewPair::new(WIDTH, HEIGHT, rendered(7), panorama(7)).unwrap();
            let view = View {
                kind: ViewKind::Novel,
                frame,
            };
            ViewFacts::of(view, &pair, true)
        })
        .collect();
    assert_eq!(order(&views, &truths), None);
    assert!(!copies::is_one_image(&views), "nor has it several images");
}

#[test]
fn copies_of_given_views_are_counted() {
    let truths = truths();
    let copies = |views: &[ViewFacts]| Comparison::new(views, &NOVEL, &truths).copies(&given());
    assert_eq!(copies(&looked(|frame| panorama(frame - 1))), 6);
    assert_eq!(copies(&looked(|frame| rendered(frame - 1))), 0);
    assert_eq!(copies(&looked(panorama)), 0);
}

#[test]
fn one_image_for_all_and_doubled_pixels_are_found() {
    assert!(copies::is_one_image(&looked(|_| rendered(4))));
    let doubled =
        looked(|frame| from_places(&rendered(frame), |column, row| [column & !1, row & !1]));
    assert!(doubled.iter().all(|view| view.is_doubled));
    let in_rows = looked(|frame| from_places(&rendered(frame), |column, row| [column & !1, row]));
    assert!(!in_rows.iter().any(|view| view.is_doubled));
}

#[test]
fn frames_that_are_given_and_held_out_are_counted() {
    let mut truths = truths();
    let given = given();
    let repeated = |truths: &Truths| {
        copies::repeated_frames(&NOVEL, &given, |frame| Some(&truths.get(&frame)?.look))
    };
    assert_eq!(repeated(&truths), None);
    truths.insert(9, truth(&panorama(8)));
    // Compression artefacts on the frame behind it.
    truths.insert(
        14,
        truth(&with_values(&panorama(15), |value, at| {
            value + at as f64 - 1.0
        })),
    );
    assert_eq!(
        repeated(&truths),
        Some(DiagnosisKind::RepeatedFrames {
            identical: 1,
            similar: 1,
            frames: 6
        })
    );
}

#[test]
fn files_that_are_named_by_place_are_found() {
    let strays = |numbers: &[u32]| -> Vec<String> {
        let names = numbers.iter().map(|number| format!("{number:06}.png"));
        names.collect()
    };
    let by_place = |numbers: &[u32]| copies::named_by_place(&strays(numbers), &NOVEL);
    assert_eq!(by_place(&[0, 1, 2, 3, 5]), Some(0));
    assert_eq!(by_place(&[1, 2, 3, 5, 6]), Some(1));
    assert_eq!(by_place(&[0, 1, 2, 3, 5, 7]), None);
    assert_eq!(by_place(&[]), None);
    assert_eq!(
        copies::named_by_place(&["comparison.png".to_owned()], &NOVEL),
        None
    );
}
