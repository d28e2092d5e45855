//! Names of files and folders that are not MCAP, with their conversion.

use std::path::Path;

/// Page that explains conversions.
const GUIDE: &str = "docs/src/guide/recordings.md";

/// Name of a compression from the first bytes of data; `None` if they are of no known one.
pub(crate) fn compression(start: &[u8]) -> Option<&'static str> {
    match start {
        [0x28, 0xb5, 0x2f, 0xfd, ..] => Some("zstd"),
        [0x04, 0x22, 0x4d, 0x18, ..] => Some("lz4"),
        [0x1f, 0x8b, ..] => Some("gzip"),
        _ => None,
    }
}

/// Describes a compressed message, and its conversion; `None` for other messages.
pub(crate) fn describe_message(data: &[u8]) -> Option<String> {
    let name = compression(data)?;
    Some(format!(
        "{name}, as rosbag2 compresses each message in mode MESSAGE; convert the bag with `ros2 bag convert` without \
         compression ({GUIDE})"
    ))
}

/// Describes a file that is not MCAP, and its conversion, from its first bytes; `None` for unknown ones.
pub(crate) fn describe_file(start: &[u8]) -> Option<String> {
    if let Some(name) = compression(start) {
        return Some(format!("a file compressed with {name}; decompress it with `{name} -d FILE`"));
    }
    let (format, target) = match start {
        [b'S', b'Q', b'L', b'i', b't', b'e', ..] => ("SQLite, as in bags of rosbag2", "FILE.db3"),
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => ("a bag of ROS 1", "FILE.bag"),
        _ => return None,
    };
    Some(format!("{format}; convert it with `mcap convert {target} OUT.mcap` ({GUIDE})"))
}

/// Describes something at a path that is no file, and the files to use if it is a folder with recordings.
pub(crate) fn describe_folder(path: &Path) -> String {
    let names = std::fs::read_dir(path).into_iter().flatten().flatten();
    let names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_recording =
        |name: &String| [".mcap", ".mcap.zstd", ".db3"].iter().any(|ending| name.ends_with(ending));
    let mut names: Vec<String> = names.filter(is_recording).collect();
    names.sort();
    let kind =
        if path.join("metadata.yaml").is_file() { "a folder of rosbag2" } else { "a folder" };
    match &names[..] {
        [] => format!("{kind} without recordings, or a pipe"),
        [name] => format!("{kind}; use {name} in it"),
        _ => format!(
            "{kind} with {}; use one of these files, or join them with `ros2 bag convert` ({GUIDE})",
            names.join(", ")
        ),
    }
}
