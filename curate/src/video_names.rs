//! Names of a dataset's videos. They do not depend on the machine on which videos were curated.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Component, Path, PathBuf},
};

/// Returns a name for every video: that of its file, behind as many of its folders as tell it from the others, between
/// `/`. A folder of all videos is never part of a name, so that names do not depend on the place of the videos. Only
/// the same file twice has one name twice.
pub fn video_names(videos: &[PathBuf]) -> Vec<String> {
    let places = below_common_folder(videos);
    let mut names = vec![String::new(); videos.len()];
    let mut open: Vec<usize> = (0..videos.len()).collect();
    let mut length = 1;
    while !open.is_empty() {
        let end_of = |index: usize| {
            let place = places[index].as_slice();
            &place[place.len().saturating_sub(length)..]
        };
        let mut alike: BTreeMap<&[String], BTreeSet<&[String]>> = BTreeMap::new();
        for &index in &open {
            let same = alike.entry(end_of(index)).or_default();
            same.insert(&places[index]);
        }
        open.retain(|&index| {
            names[index] = end_of(index).join("/");
            alike
                .get(end_of(index))
                .is_some_and(|places| places.len() > 1)
        });
        length += 1;
    }
    names
}

/// Returns the folders and the name of every file, without the common folders of all files.
fn below_common_folder(files: &[PathBuf]) -> Vec<Vec<String>> {
    let mut places: Vec<Vec<String>> = files.iter().map(|file| parts(file)).collect();
    let first = places.first().cloned().unwrap_or_default();
    let shared = |other: &Vec<String>| {
        let folders = first.len().min(other.len()).saturating_sub(1);
        let both = first.iter().zip(other).take(folders);
        both.take_while(|(a, b)| a == b).count()
    };
    let common = places.iter().map(shared).min().unwrap_or(0);
    for place in &mut places {
        place.drain(..common);
    }
    places
}

/// Returns the names on the path to a file from the root, with steps up resolved.
fn parts(file: &Path) -> Vec<String> {
    // Without a current folder, no relative path can be resolved.
    let absolute = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let mut parts = Vec::new();
    for part in absolute.components() {
        match part {
            Component::Normal(name) => parts.push(name.to_string_lossy().into_owned()),
            Component::ParentDir => drop(parts.pop()),
            Component::Prefix(_) | Component::RootDir | Component::CurDir => {}
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(files: &[&str]) -> Vec<String> {
        let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
        video_names(&files)
    }

    #[test]
    fn names_have_as_many_folders_as_tell_them_apart() {
        assert_eq!(names(&[]), [""; 0]);
        assert_eq!(names(&["/home/ann/x.mp4"]), ["x.mp4"]);
        assert_eq!(
            names(&["/m/a/x.mp4", "/m/b/x.mp4", "/m/b/y.mp4"]),
            ["a/x.mp4", "b/x.mp4", "y.mp4"]
        );
        assert_eq!(
            names(&["/m/1/day/x.mp4", "/m/2/day/x.mp4", "/m/2/night/x.mp4"]),
            ["1/day/x.mp4", "2/day/x.mp4", "night/x.mp4"]
        );
        // One lies above the other: their common folder does not belong to a name.
        assert_eq!(
            names(&[
                "/home/ann/x.mp4",
                "/home/ann/b/x.mp4",
                "/home/ann/b/c/x.mp4"
            ]),
            ["x.mp4", "b/x.mp4", "c/x.mp4"]
        );
    }

    #[test]
    fn one_file_has_one_name_however_it_is_reached() {
        assert_eq!(
            names(&["/m/a/x.mp4", "/m/b/../a/./x.mp4", "/m/b/x.mp4"]),
            ["a/x.mp4", "a/x.mp4", "b/x.mp4"]
        );
        assert_eq!(names(&["a/x.mp4", "../x.mp4"])[0], "a/x.mp4");
        assert_eq!(names(&["x.mp4", "./x.mp4"]), ["x.mp4", "x.mp4"]);
    }
}
