//! Folders of still panoramas: order, times, places and crops.

use std::path::PathBuf;

use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};
use omnilife_curate::{CurateSettings, curate_dataset};
use omnilife_schemas::{
    camera::Camera,
    records::{Sequence, VideoStatus},
};

use super::{
    foreign::{Foreign, notes},
    *,
};

const SIZE: [u32; 2] = [128, 64];

/// A picture of a sphere: whole across the seam, of one colour at the poles, of its own for each number.
fn colour([width, height]: [u32; 2], x: u32, y: u32, number: u8) -> [u8; 3] {
    let longitude = (f64::from(x) + 0.5) / f64::from(width) * TAU;
    let latitude = (0.5 - (f64::from(y) + 0.5) / f64::from(height)) * PI;
    let wave = |turns: f64| latitude.cos() * (turns * longitude + 0.4 * f64::from(number)).sin();
    [
        (128.0 + 90.0 * wave(1.0)) as u8,
        (110.0 + 80.0 * wave(2.0) + 20.0 * latitude) as u8,
        (120.0 + 60.0 * wave(3.0)) as u8,
    ]
}

/// A JPEG with metadata of a camera.
struct Photo<'a> {
    number: u8,
    size: [u32; 2],
    exif: Option<Vec<u8>>,
    xmp: Option<&'a str>,
}

impl Photo<'_> {
    fn write(&self, path: &Path) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        let [width, height] = self.size;
        let pixels: Vec<u8> = (0..width * height)
            .flat_map(|at| colour(self.size, at % width, at / width, self.number))
            .collect();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, 95)
            .encode(&pixels, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        let mut segments = Vec::new();
        let exif = self
            .exif
            .iter()
            .map(|tiff| [b"Exif\0\0", tiff.as_slice()].concat());
        let xmp = self
            .xmp
            .iter()
            .map(|xml| [b"http://ns.adobe.com/xap/1.0/\0", xml.as_bytes()].concat());
        for content in exif.chain(xmp) {
            segments.extend([0xff, 0xe1]);
            segments.extend((content.len() as u16 + 2).to_be_bytes());
            segments.extend(content);
        }
        let file = [&jpeg[..2], &segments, &jpeg[2..]].concat();
        fs::write(path, file).unwrap();
    }
}

/// EXIF data as cameras write them: the time, and a place where one is given.
fn exif(time: &str, fraction: Option<&str>, place: Option<[f64; 2]>) -> Vec<u8> {
    /// Tag, type, count, and the value or what stands elsewhere.
    type Entry = (u16, u16, u32, Vec<u8>);
    let ascii = |tag: u16, text: &str| -> Entry {
        let bytes = [text.as_bytes(), b"\0"].concat();
        (tag, 2, bytes.len() as u32, bytes)
    };
    let rationals = |tag: u16, numbers: &[(u32, u32)]| -> Entry {
        let bytes = numbers
            .iter()
            .flat_map(|(a, b)| [a.to_le_bytes(), b.to_le_bytes()]);
        (tag, 5, numbers.len() as u32, bytes.flatten().collect())
    };
    let directory = |entries: &[Entry], at: usize| -> Vec<u8> {
        let mut table = (entries.len() as u16).to_le_bytes().to_vec();
        let mut rest: Vec<u8> = Vec::new();
        let after = at + 2 + 12 * entries.len() + 4;
        for (tag, kind, count, value) in entries {
            table.extend(tag.to_le_bytes());
            table.extend(kind.to_le_bytes());
            table.extend(count.to_le_bytes());
            if value.len() <= 4 {
                let mut short = value.clone();
                short.resize(4, 0);
                table.extend(short);
            } else {
                table.extend(((after + rest.len()) as u32).to_le_bytes());
                rest.extend(value);
            }
        }
        table.extend([0; 4]);
        table.extend(rest);
        table
    };
    let mut of_exif = vec![ascii(0x9003, time)];
    of_exif.extend(fraction.map(|fraction| ascii(0x9291, fraction)));
    let degrees = |angle: f64| {
        let whole = angle.abs().floor();
        let minutes = (angle.abs() - whole) * 60.0;
        [
            (whole as u32, 1),
            ((minutes * 1e6).round() as u32, 1_000_000),
            (0, 1),
        ]
    };
    let of_place = place.map(|[latitude, longitude]| {
        vec![
            ascii(1, if latitude < 0.0 { "S" } else { "N" }),
            rationals(2, &degrees(latitude)),
            ascii(3, if longitude < 0.0 { "W" } else { "E" }),
            rationals(4, &degrees(longitude)),
            rationals(6, &[(12_345, 100)]),
            rationals(17, &[(905, 10)]),
        ]
    });
    let pointers = 1 + usize::from(of_place.is_some());
    let exif_at = 8 + 2 + 12 * pointers + 4;
    let exif_bytes = directory(&of_exif, exif_at);
    let place_at = exif_at + exif_bytes.len();
    let pointer =
        |tag: u16, at: usize| -> Entry { (tag, 4, 1, (at as u32).to_le_bytes().to_vec()) };
    let mut first = vec![pointer(0x8769, exif_at)];
    first.extend(of_place.as_ref().map(|_| pointer(0x8825, place_at)));
    let mut tiff = b"II*\0\x08\0\0\0".to_vec();
    tiff.extend(directory(&first, 8));
    tiff.extend(exif_bytes);
    tiff.extend(
        of_place
            .iter()
            .flat_map(|entries| directory(entries, place_at)),
    );
    tiff
}

fn gpano(properties: &str) -> String {
    format!(
        "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
         <rdf:Description xmlns:GPano=\"http://ns.google.com/photos/1.0/panorama/\" {properties}/></rdf:RDF></x:xmpmeta>"
    )
}

/// Writes photos by their names into the folder to import.
fn write(foreign: &Foreign, photos: &[(&str, Photo<'_>)]) -> PathBuf {
    let folder = foreign.path().join("in");
    for (name, photo) in photos {
        photo.write(&folder.join(name));
    }
    folder
}

fn plain(number: u8) -> Photo<'static> {
    Photo {
        number,
        size: SIZE,
        exif: None,
        xmp: None,
    }
}

fn imported(foreign: &Foreign) -> Result<Scene, CurateError> {
    store::remove(&foreign.path().join("out")).unwrap();
    import(&ImportRequest::new(
        &foreign.path().join("in"),
        "panoramas",
        "stills",
        &foreign.path().join("out"),
    ))
}

#[test]
fn times_and_places_of_cameras_are_kept() {
    let foreign = Foreign::new(SIZE, &[]);
    let photo = |number: u8, time: &str, fraction| Photo {
        exif: Some(exif(
            time,
            fraction,
            Some([-33.5 - f64::from(number), 151.25]),
        )),
        ..plain(number)
    };
    write(
        &foreign,
        &[
            ("R10.JPG", photo(3, "2024:02:29 00:00:03", None)),
            ("R2.JPG", photo(1, "2024:02:28 23:59:58", Some("25"))),
            ("R9.JPG", photo(2, "2024:02:29 00:00:01", None)),
        ],
    );
    let scene = imported(&foreign).unwrap();
    let times: Vec<f64> = scene
        .frames
        .iter()
        .map(|frame| frame.time_seconds)
        .collect();
    assert_eq!(times, [0.0, 2.75, 4.75]);
    assert!(scene.frames.iter().all(|frame| frame.pose.is_none()));
    let capture = scene.frames[0].capture.as_ref().unwrap();
    assert_eq!(capture.time.as_deref(), Some("2024-02-28T23:59:58.250"));
    let near = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-6;
    assert!(near(capture.latitude_degrees, -34.5));
    assert!(near(capture.longitude_degrees, 151.25));
    assert!(near(capture.altitude_metres, 123.45));
    assert!(near(capture.direction_degrees, 90.5));
    assert!(notes(&scene, "times are those of the EXIF data"));
    // The files are copied byte for byte.
    let copy = fs::read(foreign.path().join("out").join(&scene.frames[0].image)).unwrap();
    assert_eq!(copy, fs::read(foreign.path().join("in/R2.JPG")).unwrap());
}

#[test]
fn without_all_times_stills_are_a_second_apart_in_natural_order() {
    let foreign = Foreign::new(SIZE, &[]);
    let late = Photo {
        exif: Some(exif("2024:05:01 10:00:09", None, None)),
        ..plain(1)
    };
    write(&foreign, &[("a10.jpg", plain(2)), ("a9.jpg", late)]);
    let scene = imported(&foreign).unwrap();
    let frames: Vec<(&str, f64)> = (scene.frames.iter())
        .map(|frame| (frame.image.as_str(), frame.time_seconds))
        .collect();
    assert_eq!(frames, [("frames/a9.jpg", 0.0), ("frames/a10.jpg", 1.0)]);
    assert!(notes(&scene, "not all images have a time"));
    // Times that run against the names decide nothing.
    let photo = |number, time: &str| Photo {
        exif: Some(exif(time, None, None)),
        ..plain(number)
    };
    let clash = Foreign::new(SIZE, &[]);
    write(
        &clash,
        &[
            ("1.jpg", photo(1, "2024:05:01 10:00:09")),
            ("2.jpg", photo(2, "2024:05:01 10:00:03")),
        ],
    );
    assert!(notes(&imported(&clash).unwrap(), "do not follow the order"));
}

#[test]
fn a_crop_is_put_at_its_place_and_the_rest_is_ignored() {
    let foreign = Foreign::new(SIZE, &[]);
    let crop = gpano(
        "GPano:ProjectionType=\"equirectangular\" GPano:FullPanoWidthPixels=\"128\" \
         GPano:FullPanoHeightPixels=\"64\" GPano:CroppedAreaImageWidthPixels=\"128\" \
         GPano:CroppedAreaImageHeightPixels=\"40\" GPano:CroppedAreaLeftPixels=\"0\" \
         GPano:CroppedAreaTopPixels=\"8\" GPano:PoseHeadingDegrees=\"200\" GPano:PoseRollDegrees=\"3\"",
    );
    let cropped = Photo {
        size: [128, 40],
        xmp: Some(&crop),
        ..plain(1)
    };
    write(&foreign, &[("1.jpg", cropped), ("2.jpg", plain(2))]);
    let scene = imported(&foreign).unwrap();
    assert_eq!(scene.camera.size(), [128, 64]);
    let out = foreign.path().join("out");
    let mask = Mask::read(&out.join(scene.frames[0].ignore_mask.as_ref().unwrap())).unwrap();
    for row in 0..64 {
        let expected = if (8..48).contains(&row) { 0 } else { 255 };
        assert!(
            mask.data[row * 128..(row + 1) * 128]
                .iter()
                .all(|&mark| mark == expected),
            "{row}"
        );
    }
    assert_eq!(scene.frames[1].ignore_mask, None);
    let image = image::open(out.join(&scene.frames[0].image))
        .unwrap()
        .to_rgb8();
    assert_eq!(image.get_pixel(5, 4).0, [0; 3]);
    let [_, green, _] = image.get_pixel(70, 8 + 20).0;
    assert!(green.abs_diff(colour([128, 40], 70, 20, 1)[1]) < 12);
    let pose = scene.frames[0].capture.as_ref().unwrap().pose_degrees;
    assert_eq!(pose, Some([200.0, 0.0, 3.0]));
    assert!(notes(&scene, "show a part of the sphere") && notes(&scene, "pitch or roll"));
}

#[test]
fn hidden_files_beside_images_are_none() {
    let foreign = Foreign::new(SIZE, &[]);
    let folder = write(&foreign, &[("1.jpg", plain(1)), ("2.jpg", plain(2))]);
    fs::write(folder.join("._1.jpg"), "Mac OS X").unwrap();
    let scene = imported(&foreign).unwrap();
    assert_eq!(scene.frames.len(), 2);
}

#[test]
fn what_is_no_panorama_is_refused_in_a_line() {
    let refuse = |photos: &[(&str, Photo<'_>)], words: &[&str]| {
        let foreign = Foreign::new(SIZE, &[]);
        fs::create_dir_all(foreign.path().join("in")).unwrap();
        write(&foreign, photos);
        let line = imported(&foreign).unwrap_err().to_string();
        assert_eq!(line.lines().count(), 1);
        assert!(words.iter().all(|word| line.contains(word)), "{line}");
        assert!(!foreign.path().join("out").exists());
    };
    let of_size = |number, size| Photo {
        size,
        ..plain(number)
    };
    refuse(
        &[("1.jpg", of_size(1, [120, 80]))],
        &["1.jpg", "120x80", "twice as wide"],
    );
    refuse(
        &[("1.jpg", plain(1)), ("2.jpg", of_size(2, [64, 32]))],
        &["2.jpg", "64x32", "1.jpg", "128x64"],
    );
    let cylinder = gpano("GPano:ProjectionType=\"cylindrical\"");
    let stated = Photo {
        xmp: Some(&cylinder),
        ..plain(1)
    };
    refuse(&[("1.jpg", stated)], &["1.jpg", "cylindrical"]);
    refuse(&[], &["must hold PNG or JPEG images"]);
}

/// Nothing but their pixels tells panoramas from a perspective clip, which the format `frames` is of.
#[test]
fn panoramas_are_no_perspective_clip() {
    let foreign = Foreign::new(SIZE, &[]);
    for number in 0..3 {
        plain(number).write(&foreign.path().join(format!("in/rgb/{number}.jpg")));
    }
    let line = foreign.refusal("frames");
    assert!(
        line.contains("--format panoramas") && line.contains("3 images"),
        "{line}"
    );
    // A perspective image of that shape is one.
    let clip = Foreign::new(SIZE, &[]);
    for number in 0..3_u32 {
        clip.paint(&format!("rgb/{number}.png"), |x, y| {
            let noise = x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503);
            [(x * 2) as u8, (255 - y * 3) as u8, (noise >> 9) as u8 / 2]
        });
    }
    assert!(matches!(
        clip.import("frames").unwrap().camera,
        Camera::Pinhole(_)
    ));
}

#[test]
fn a_folder_of_stills_is_curated_into_a_sequence() {
    let foreign = Foreign::new(SIZE, &[]);
    let folder = write(
        &foreign,
        &[
            ("b2.jpg", plain(1)),
            ("b10.jpg", plain(2)),
            ("b11.jpg", plain(3)),
        ],
    );
    let out = foreign.path().join("dataset");
    let settings = CurateSettings::default();
    let curate = || {
        let inputs = omnilife_curate::expand_inputs(std::slice::from_ref(&folder)).unwrap();
        curate_dataset(&inputs, &out, &settings, &Silent).unwrap()
    };
    let curated = curate();
    let VideoStatus::Curated { sequences } = &curated.record.videos[0].status else {
        panic!("{:?}", curated.record);
    };
    assert_eq!(sequences, &["videos/in/seq-000"]);
    drop(curated);
    let place = out.join("videos/in/seq-000");
    let read = || -> Sequence { store::read_record(&place.join("sequence.json")).unwrap() };
    let sequence = read();
    let times: Vec<f64> = (sequence.frames.entries.iter())
        .map(|entry| entry.time_seconds)
        .collect();
    assert_eq!(times, [0.0, 1.0, 2.0]);
    assert_eq!([sequence.frames.width, sequence.frames.height], SIZE);
    let first = image::open(place.join(&sequence.frames.entries[0].file)).unwrap();
    let expected = colour(SIZE, 40, 30, 1);
    let found = first.to_rgb8().get_pixel(40, 30).0;
    assert!(
        found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) < 10),
        "{found:?}"
    );
    // Again nothing is written anew; with another still everything is.
    let stamp = fs::metadata(place.join("frames/000000.png"))
        .unwrap()
        .modified()
        .unwrap();
    drop(curate());
    assert_eq!(read(), sequence);
    let again = fs::metadata(place.join("frames/000000.png"))
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(stamp, again);
}
