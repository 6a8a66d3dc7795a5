//! Published splits: which lists are taken, which are refused.

use super::*;
use crate::exchange::foreign::notes;

/// A scene in the layout of `OmniBlender` with frames of these names, all at one place.
fn with_lists(train: Option<&str>, test: Option<&str>) -> Foreign {
    let images: Vec<(String, u8)> = (1..=4)
        .map(|n: u8| (format!("images/{n}.png"), n))
        .collect();
    let images: Vec<(&str, u8)> = images.iter().map(|(name, n)| (name.as_str(), *n)).collect();
    let foreign = Foreign::new(SIZE, &images);
    let unit = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let frames: Vec<Value> = (1..=4)
        .map(|n| serde_json::json!({"file_path": format!("{n}.png"), "transform_matrix": unit}))
        .collect();
    let transforms = serde_json::json!({"frames": frames});
    foreign.write("transform.json", transforms.to_string());
    for (name, list) in [("train.txt", train), ("test.txt", test)] {
        if let Some(list) = list {
            foreign.write(name, list);
        }
    }
    foreign
}

#[test]
fn images_are_named_by_stem_file_or_place() {
    let foreign = with_lists(Some("\u{feff}4\r\n\r\n 1.png \r\n"), Some("images/3.png"));
    let scene = foreign.import("omniblender").unwrap();
    assert_eq!(split_of(&scene), (vec![0, 3], vec![2]));
    let split = scene.published_split.unwrap();
    assert!(split.source.contains("train.txt") && split.source.contains("OmniBlender"));
}

#[test]
fn views_are_numbers_in_order_of_time() {
    let foreign = with_lists(Some("1\n2\n"), Some("4\n"));
    foreign.write(
        "times.csv",
        "image,time_seconds\n1.png,9\n2.png,1\n3.png,5\n4.png,2\n",
    );
    let scene = foreign.import("omniblender").unwrap();
    assert_eq!(times(&scene), [1.0, 2.0, 5.0, 9.0]);
    assert_eq!(split_of(&scene), (vec![0, 3], vec![1]));
}

#[test]
fn lists_that_make_no_split_are_refused() {
    for (train, test, what) in [
        ("1\n7\n", "2\n", "names 7"),
        ("1\n1\n", "2\n", "1 twice"),
        ("1\n2\n", "2.png\n", "for training and for testing"),
        ("\n", "2\n", "no image for training"),
        ("1\n", "", "no image for testing"),
    ] {
        let line = with_lists(Some(train), Some(test)).refusal("omniblender");
        assert!(line.contains(what), "{line}");
        assert!(
            line.contains("OmniBlender, train.txt and test.txt"),
            "{line}"
        );
    }
    for (train, test, missing) in [
        (Some("1\n"), None, "test.txt"),
        (None, Some("1\n"), "train.txt"),
    ] {
        let line = with_lists(train, test).refusal("omniblender");
        assert!(line.contains(missing), "{line}");
    }
}

#[test]
fn a_scene_without_lists_has_no_split_and_says_so() {
    let scene = with_lists(None, None).import("omniblender").unwrap();
    assert!(scene.published_split.is_none());
    assert!(notes(&scene, "train.txt and test.txt"));
}
