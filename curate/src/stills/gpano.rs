//! Google's panorama metadata (GPano) in the XMP data of a still: its part of the sphere, and the orientation of its
//! middle.
//!
//! (<https://developers.google.com/streetview/spherical-metadata>.) The properties are attributes of an
//! `rdf:Description` or elements in it.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use roxmltree::Document;

use omnilife_schemas::image_file::MOST_PIXELS;

use super::placement::Placement;

const NAMESPACE: &str = "http://ns.google.com/photos/1.0/panorama/";
/// Maximum size of XMP data, bytes: those of a panorama are a few thousand.
const MOST_BYTES: usize = 1 << 20;

/// Properties of a panorama.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Panorama {
    /// The image's part of the sphere, unless it is all of it.
    pub(crate) placement: Option<Placement>,
    /// Heading, pitch and roll of the sphere's middle, degrees, if stated.
    pub(crate) pose_degrees: Option<[f64; 3]>,
}

/// Reads XMP data of an image of `size` pixels; `None` if they do not describe a panorama.
///
/// # Errors
/// For another projection than equirectangular, and invalid numbers; one line.
pub(crate) fn read(data: &[u8], size: [u32; 2]) -> Result<Option<Panorama>, String> {
    if data.len() > MOST_BYTES {
        return Err(format!(
            "its XMP data have {} bytes, expected at most {MOST_BYTES}",
            data.len()
        ));
    }
    let text =
        std::str::from_utf8(data).map_err(|_| "its XMP data must be UTF-8 text".to_owned())?;
    // Packets may be padded with zeros, and have their processing instruction behind a byte order mark.
    let text = text.trim_matches(['\0', '\u{feff}', ' ', '\n', '\r', '\t']);
    let document =
        Document::parse(text).map_err(|error| format!("its XMP data must be XML: {error}"))?;
    let property = |name: &str| {
        let nodes = document.descendants();
        nodes
            .filter_map(|node| {
                let is_element = node.is_element()
                    && node.tag_name().name() == name
                    && node.tag_name().namespace() == Some(NAMESPACE);
                let element = is_element.then(|| node.text()).flatten();
                node.attribute((NAMESPACE, name)).or(element)
            })
            .map(str::trim)
            .next()
            .map(str::to_owned)
    };
    let names = document.descendants().any(|node| {
        node.tag_name().namespace() == Some(NAMESPACE)
            || (node.attributes()).any(|attribute| attribute.namespace() == Some(NAMESPACE))
    });
    if !names {
        return Ok(None);
    }
    if let Some(projection) = property("ProjectionType")
        && projection != "equirectangular"
    {
        return Err(format!(
            "its metadata say that it is {projection}, expected equirectangular"
        ));
    }
    Ok(Some(Panorama {
        placement: placement(&property, size)?,
        pose_degrees: pose(&property)?,
    }))
}

/// Returns the number of a property.
///
/// # Errors
/// When the property is not a finite number.
fn number(property: &impl Fn(&str) -> Option<String>, name: &str) -> Result<Option<f64>, String> {
    let Some(text) = property(name) else {
        return Ok(None);
    };
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(Some(number)),
        _ => Err(format!("its {name} is {text:?}, expected a number")),
    }
}

fn placement(
    property: &impl Fn(&str) -> Option<String>,
    [width, height]: [u32; 2],
) -> Result<Option<Placement>, String> {
    let pixels = |name: &str| -> Result<Option<u32>, String> {
        let Some(number) = number(property, name)? else {
            return Ok(None);
        };
        let pixels = number as u32;
        if f64::from(pixels) == number {
            return Ok(Some(pixels));
        }
        Err(format!(
            "its {name} is {number}, expected a number of pixels"
        ))
    };
    let full = [
        pixels("FullPanoWidthPixels")?,
        pixels("FullPanoHeightPixels")?,
    ];
    let cropped = [
        pixels("CroppedAreaImageWidthPixels")?,
        pixels("CroppedAreaImageHeightPixels")?,
    ];
    let corner = [
        pixels("CroppedAreaLeftPixels")?,
        pixels("CroppedAreaTopPixels")?,
    ];
    let [Some(full_width), Some(full_height)] = full else {
        return Ok(None);
    };
    let [cropped_width, cropped_height] =
        [cropped[0].unwrap_or(width), cropped[1].unwrap_or(height)];
    if u64::from(full_width).saturating_mul(u64::from(full_height)) > MOST_PIXELS {
        return Err(format!(
            "its metadata are of a sphere of {full_width}x{full_height}, expected at most {MOST_PIXELS} pixels"
        ));
    }
    let is_whole = [cropped_width, cropped_height] == [full_width, full_height];
    if is_whole && corner.iter().all(|at| at.unwrap_or_default() == 0) {
        // The whole sphere, perhaps rescaled since.
        return Ok(None);
    }
    let [Some(left), Some(top)] = corner else {
        return Err(
            "its metadata are of a part of a sphere, and do not say where it lies".to_owned(),
        );
    };
    if [cropped_width, cropped_height] != [width, height] {
        return Err(format!(
            "its metadata are of a crop of {cropped_width}x{cropped_height}, and it is {width}x{height}"
        ));
    }
    Placement::new([full_width, full_height], [width, height], [left, top])
}

fn pose(property: &impl Fn(&str) -> Option<String>) -> Result<Option<[f64; 3]>, String> {
    let names = ["PoseHeadingDegrees", "PosePitchDegrees", "PoseRollDegrees"];
    let mut degrees = [0.0; 3];
    let mut is_stated = false;
    for (degrees, name) in degrees.iter_mut().zip(names) {
        if let Some(number) = number(property, name)? {
            *degrees = number;
            is_stated = true;
        }
    }
    Ok(is_stated.then_some(degrees))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attributes(list: &str) -> String {
        format!(
            "<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:RDF xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>\
             <rdf:Description xmlns:GPano='{NAMESPACE}' {list}/></rdf:RDF></x:xmpmeta>"
        )
    }

    #[test]
    fn both_forms_say_the_same() {
        let form = attributes(
            "GPano:ProjectionType='equirectangular' GPano:FullPanoWidthPixels='400' \
             GPano:FullPanoHeightPixels='200' GPano:CroppedAreaImageWidthPixels='100' \
             GPano:CroppedAreaImageHeightPixels='50' GPano:CroppedAreaLeftPixels='20' \
             GPano:CroppedAreaTopPixels='30' GPano:PoseHeadingDegrees='12.5'",
        );
        let of_attributes = read(form.as_bytes(), [100, 50]).expect("sound");
        let elements = form
            .replace(" GPano:", "><GPano:")
            .replace("/></rdf:RDF>", "></rdf:Description></rdf:RDF>");
        let mut text = String::new();
        for part in elements.split('>') {
            match part
                .strip_prefix("<GPano:")
                .and_then(|rest| rest.split_once('='))
            {
                Some((name, value)) => {
                    let value = value.trim_matches('\'');
                    text.push_str(&format!("<GPano:{name}>{value}</GPano:{name}>"));
                }
                None if part.is_empty() => {}
                None => text.push_str(&format!("{part}>")),
            }
        }
        let of_elements = read(text.as_bytes(), [100, 50]).expect("sound");
        assert_eq!(of_attributes, of_elements);
        let panorama = of_attributes.expect("a panorama");
        assert_eq!(panorama.pose_degrees, Some([12.5, 0.0, 0.0]));
        assert!(panorama.placement.is_some());
    }

    #[test]
    fn whole_spheres_and_other_metadata_have_no_place() {
        let whole = attributes("GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='200'");
        let found = read(whole.as_bytes(), [400, 200])
            .expect("sound")
            .expect("a panorama");
        assert_eq!(found.placement, None);
        // Rescaled since, with the original metadata.
        let scaled = read(whole.as_bytes(), [100, 50]);
        assert!(scaled.is_err(), "no crop is stated: {scaled:?}");
        let both = format!(
            "{} {}",
            "GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='200'",
            "GPano:CroppedAreaImageWidthPixels='400' GPano:CroppedAreaImageHeightPixels='200'"
        );
        let scaled = read(attributes(&both).as_bytes(), [100, 50]);
        assert!(scaled.is_ok_and(|found| found.is_some_and(|found| found.placement.is_none())));
        let padded = format!(
            "\u{feff}{}\0\0",
            attributes("other='1'").replace("xmlns:GPano", "xmlns:g")
        );
        assert_eq!(read(padded.as_bytes(), [4, 2]), Ok(None));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        for (list, reason) in [
            ("GPano:ProjectionType='cylindrical'", "cylindrical"),
            (
                "GPano:FullPanoWidthPixels='x' GPano:FullPanoHeightPixels='2'",
                "FullPanoWidthPixels",
            ),
            (
                "GPano:FullPanoWidthPixels='40.5' GPano:FullPanoHeightPixels='2'",
                "number of pixels",
            ),
            (
                "GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='100' GPano:CroppedAreaTopPixels='0' \
                 GPano:CroppedAreaLeftPixels='0'",
                "twice as wide",
            ),
            (
                "GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='200' GPano:CroppedAreaTopPixels='180' \
                 GPano:CroppedAreaLeftPixels='0'",
                "reaches",
            ),
            (
                "GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='200' \
                 GPano:CroppedAreaImageWidthPixels='99' GPano:CroppedAreaTopPixels='0' \
                 GPano:CroppedAreaLeftPixels='0'",
                "99x50",
            ),
            (
                "GPano:FullPanoWidthPixels='400' GPano:FullPanoHeightPixels='200' GPano:CroppedAreaLeftPixels='0'",
                "do not say where",
            ),
            (
                "GPano:FullPanoWidthPixels='2000000' GPano:FullPanoHeightPixels='1000000'",
                "at most",
            ),
            ("GPano:PoseRollDegrees='inf'", "PoseRollDegrees"),
        ] {
            let error = read(attributes(list).as_bytes(), [100, 50]).expect_err(list);
            assert!(error.contains(reason), "{list}: {error}");
        }
        assert!(read(b"<a", [4, 2]).is_err());
        assert!(read(&[0xff, 0xfe], [4, 2]).is_err());
    }
}
