//! Tests of files: equal bytes, truncated files, damaged files, files of other programs.

mod common;

use ballast_mcap::messages::MessageReader;
use ballast_mcap::recording::{self, WindowReader};
use ballast_mcap::{
    Drive, Error, McapWriter, RecordingMetadata, TopicMessage, may_become_a_recording,
};
use ballast_protocol::from_cdr;
use ballast_protocol::messages::{Header, PoseStamped};
use mcap::records::op;
use std::collections::BTreeMap;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn meta() -> RecordingMetadata {
    RecordingMetadata {
        program: "ballast 0".into(),
        case_name: "case".into(),
        case_key: "key".into(),
        case_text: "[case]".into(),
        step_ns: 1000,
        schedule: "synchronous".into(),
        drive: Drive::Inputs,
        overrides: BTreeMap::from([("seed".into(), "7".into())]),
        initial_hash: 12_u128.into(),
    }
}

fn pose(i: u64) -> TopicMessage {
    let mut message = PoseStamped { header: Header::world(i * 1000), ..PoseStamped::default() };
    message.pose.position.x = (i as f64 * 0.1).sin();
    TopicMessage::of(format!("/body_{}/pose", i % 3), i * 1000, &message).unwrap()
}

/// Number of messages, enough for several chunks.
const MESSAGES: u64 = 3000;

fn write(path: &Path, meta: Option<&RecordingMetadata>) {
    let mut writer = McapWriter::create(path, meta).unwrap();
    (0..MESSAGES).for_each(|i| writer.write(&pose(i)).unwrap());
    writer.finish().unwrap();
}

fn place(name: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

/// Returns the times of the readable messages, and the reason of an early end.
fn read(path: &Path) -> Result<(Vec<u64>, Option<String>), Error> {
    let mut messages = MessageReader::open(path)?;
    let mut times = Vec::new();
    while let Some(message) = messages.next()? {
        times.push(message.log_time);
    }
    let lost = messages.truncation();
    assert!(lost.is_none_or(|lost| lost.messages == times.len() as u64));
    Ok((times, lost.map(|lost| lost.reason.clone())))
}

fn all_times() -> Vec<u64> {
    (0..MESSAGES).map(|i| i * 1000).collect()
}

fn header(channel_id: u16, time_ns: u64) -> mcap::records::MessageHeader {
    let (log_time, publish_time) = (time_ns, time_ns);
    mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time }
}

#[test]
fn equal_messages_give_equal_bytes_and_can_be_read() {
    let (_folder, path) = place("a.mcap");
    let other = path.with_file_name("b.mcap");
    write(&path, Some(&meta()));
    write(&other, Some(&meta()));
    assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&other).unwrap());
    assert_eq!(read(&path).unwrap(), (all_times(), None));
    assert!(recording::is_recording(&path).unwrap());
    assert_eq!(*WindowReader::open(&path).unwrap().meta(), meta());
    let mut messages = MessageReader::open(&path).unwrap();
    let first = messages.next().unwrap().unwrap();
    assert_eq!(first.channel.schema, "geometry_msgs/msg/PoseStamped");
    assert_eq!(from_cdr::<PoseStamped>(&first.data).unwrap().header, Header::world(0));
}

#[test]
fn a_recording_that_was_removed_cannot_be_finished() {
    let (_folder, path) = place("a.mcap");
    for replaced in [false, true] {
        let mut writer = McapWriter::create(&path, Some(&meta())).unwrap();
        writer.write(&pose(0)).unwrap();
        std::fs::remove_file(&path).unwrap();
        if replaced {
            std::fs::write(&path, "another").unwrap();
        }
        let message = writer.finish().unwrap_err().to_string();
        assert!(
            message.contains("a.mcap: recording: expected the file that was created"),
            "{message}"
        );
        assert!(message.contains("another file, or none, at this path"), "{message}");
    }
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "another");
    // A link leads to the file that was begun.
    let link = path.with_file_name("link.mcap");
    std::os::unix::fs::symlink("b.mcap", &link).unwrap();
    write(&link, Some(&meta()));
    assert_eq!(read(&link).unwrap(), (all_times(), None));
}

#[test]
fn a_topic_keeps_its_type() {
    let (_folder, path) = place("a.mcap");
    let mut writer = McapWriter::create(&path, None).unwrap();
    writer.write(&pose(0)).unwrap();
    let other = TopicMessage::of("/body_0/pose", 0, &Header::world(0)).unwrap();
    let error = writer.write(&other).unwrap_err().to_string();
    assert!(error.contains("/body_0/pose") && error.contains("std_msgs/msg/Header"), "{error}");
}

#[test]
fn only_a_file_becomes_a_recording() {
    let (folder, path) = place("pipe");
    let measured = folder.path().join("measured.mcap");
    let mut writer = McapWriter::create(&measured, None).unwrap();
    writer.write(&pose(0)).unwrap();
    writer.finish().unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    for (at, found) in [
        (path.as_path(), "a device or a pipe"),
        (Path::new("/dev/null"), "a device or a pipe"),
        (folder.path(), "a folder"),
        (&measured, "one of another program"),
    ] {
        let message = may_become_a_recording(at).unwrap_err().to_string();
        let expected = "expected a new file, or a Ballast recording to replace, found ";
        assert!(message.ends_with(&format!("{expected}{found}")), "{message}");
    }
    may_become_a_recording(&folder.path().join("new.mcap")).unwrap();
}

#[test]
fn a_file_cut_short_is_read_up_to_its_last_whole_chunk() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let whole = std::fs::read(&path).unwrap();
    let cut = path.with_file_name("cut.mcap");
    let mut counts = Vec::new();
    // The last bytes are index and footer: without them all messages are readable.
    for part in 1..60 {
        std::fs::write(&cut, &whole[..whole.len() * part / 60]).unwrap();
        match read(&cut) {
            Ok((times, lost)) => {
                assert_eq!(times, all_times()[..times.len()]);
                assert!(lost.is_some() || times.len() as u64 == MESSAGES);
                counts.push(times.len());
            }
            Err(error) => assert!(error.to_string().contains("cut.mcap"), "{error}"),
        }
    }
    counts.dedup();
    assert!(counts.is_sorted() && counts.len() > 3, "several chunks: {counts:?}");
}

#[test]
fn a_killed_writer_leaves_its_chunks() {
    let (_folder, path) = place("a.mcap");
    let mut writer = McapWriter::create(&path, Some(&meta())).unwrap();
    (0..MESSAGES).for_each(|i| writer.write(&pose(i)).unwrap());
    // As after a kill: the bytes written so far.
    let killed = path.with_file_name("killed.mcap");
    std::fs::copy(&path, &killed).unwrap();
    let (times, lost) = read(&killed).unwrap();
    assert!(lost.is_some());
    assert!(times.len() > 2000 && times == all_times()[..times.len()], "{}", times.len());
    writer.finish().unwrap();
}

#[test]
fn changed_bytes_cause_no_panic() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let whole = std::fs::read(&path).unwrap();
    let broken = path.with_file_name("broken.mcap");
    let mut noticed = 0;
    for at in (0..whole.len()).step_by(whole.len() / 400) {
        for value in [whole[at] ^ 1, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            std::fs::write(&broken, bytes).unwrap();
            match read(&broken) {
                Ok((_, None)) => {}
                _ => noticed += 1,
            }
            let _ = WindowReader::open(&broken).and_then(|mut windows| windows.next());
        }
    }
    assert!(noticed > 200, "checksums of chunks: {noticed}");
}

/// Returns true if the reader reports damage, not truncation.
fn is_damaged(path: &Path, bytes: &[u8]) -> bool {
    std::fs::write(path, bytes).unwrap();
    let Ok(mut messages) = MessageReader::open(path) else { return true };
    while messages.next().unwrap().is_some() {}
    messages.truncation().is_some_and(|lost| !lost.is_cut)
}

#[test]
fn a_changed_bit_of_kind_or_length_is_detected() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let whole = std::fs::read(&path).unwrap();
    let broken = path.with_file_name("broken.mcap");
    for begin in common::records(&whole).0 {
        for (at, bit) in (begin..begin + 9).flat_map(|at| (0..8).map(move |bit| (at, bit))) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            assert!(is_damaged(&broken, &bytes), "kind {}, {at}, {bit}", whole[begin]);
        }
    }
}

#[test]
fn a_recording_of_windows_may_have_a_long_attachment() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let whole = std::fs::read(&path).unwrap();
    let (name, length) = (b"video.mp4", 300_000_000_u64);
    let start = [&[0; 16][..], &(name.len() as u32).to_le_bytes(), name].concat();
    for at in
        common::records(&whole).0.into_iter().skip(1).filter(|at| whole[*at] == op::CHUNK).take(2)
    {
        let mut file = std::fs::File::create(&path).unwrap();
        let head = [&[op::ATTACHMENT][..], &length.to_le_bytes(), &start].concat();
        file.write_all(&[&whole[..at], &head].concat()).unwrap();
        file.seek(SeekFrom::Current((length - start.len() as u64) as i64)).unwrap();
        file.write_all(&whole[at..]).unwrap();
        assert_eq!(read(&path).unwrap(), (all_times(), None));
        assert!(recording::is_recording(&path).unwrap());
    }
}

#[test]
fn a_missing_chunk_is_detected_without_checksums() {
    let (_folder, path) = place("a.mcap");
    for has_index in [true, false] {
        let file = std::fs::File::create(&path).unwrap();
        let options = mcap::WriteOptions::new().chunk_size(Some(1000)).use_chunks(true);
        let options = options.calculate_data_section_crc(false).emit_message_indexes(has_index);
        let mut writer = options.create(std::io::BufWriter::new(file)).unwrap();
        let channel = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
        (0..1000).for_each(|i| writer.write_to_known_channel(&header(channel, i), b"{}").unwrap());
        writer.finish().unwrap();
        drop(writer);
        assert_eq!(read(&path).unwrap(), ((0..1000).collect(), None));
        let whole = std::fs::read(&path).unwrap();
        let chunks = common::records(&whole).0.into_iter().filter(|at| whole[*at] == op::CHUNK);
        let chunk = chunks.collect::<Vec<_>>()[3];
        let broken = path.with_file_name("broken.mcap");
        // The last is a private kind.
        for kind in [0, op::MESSAGE_INDEX, op::CHUNK_INDEX, op::ATTACHMENT, op::FOOTER, 0x86] {
            let mut bytes = whole.clone();
            bytes[chunk] = kind;
            assert!(is_damaged(&broken, &bytes), "{kind}, index: {has_index}");
        }
    }
}

#[test]
fn chunks_of_other_programs_are_read() {
    let (_folder, path) = place("a.mcap");
    let packed = [None, Some(mcap::Compression::Lz4), Some(mcap::Compression::Zstd)];
    for (compression, chunks) in packed.into_iter().flat_map(|c| [(c, true), (c, false)]) {
        let file = std::fs::File::create(&path).unwrap();
        let options = mcap::WriteOptions::new().compression(compression).use_chunks(chunks);
        let mut writer = options.create(std::io::BufWriter::new(file)).unwrap();
        let channel = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
        for i in 0..100 {
            writer.write_to_known_channel(&header(channel, i), b"{}").unwrap();
        }
        writer.finish().unwrap();
        drop(writer);
        let (times, lost) = read(&path).unwrap();
        assert_eq!((times.len(), lost), (100, None));
        assert!(!recording::is_recording(&path).unwrap());
        let error = WindowReader::open(&path).err().unwrap().to_string();
        assert!(error.contains("a recording of Ballast"), "{error}");
    }
}

#[test]
fn chunks_with_wrong_lengths_are_refused() {
    let (_folder, path) = place("a.mcap");
    let file = std::fs::File::create(&path).unwrap();
    let mut writer = mcap::WriteOptions::new().compression(None).create(file).unwrap();
    let channel = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 1,
        publish_time: 1,
    };
    writer.write_to_known_channel(&header, b"mark").unwrap();
    writer.finish().unwrap();
    drop(writer);
    let whole = std::fs::read(&path).unwrap();
    let mark = whole.windows(4).position(|w| w == b"mark").unwrap();
    // The message's length: longer than the chunk, longer than any memory.
    for length in [1000_u64, u64::MAX] {
        let mut bytes = whole.clone();
        bytes[mark - 30..mark - 22].copy_from_slice(&length.to_le_bytes());
        std::fs::write(&path, &bytes).unwrap();
        let (times, lost) = read(&path).unwrap();
        assert!(times.is_empty());
        assert!(lost.unwrap().contains("chunk"));
    }
}

#[test]
fn an_unknown_record_in_a_chunk_is_reported() {
    let (_folder, path) = place("a.mcap");
    for ours in [false, true] {
        let file = std::fs::File::create(&path).unwrap();
        let options = mcap::WriteOptions::new().compression(None);
        let options = options.calculate_chunk_crcs(false).calculate_data_section_crc(false);
        let mut writer = options.create(file).unwrap();
        if ours {
            let (name, metadata) = ("ballast".into(), BTreeMap::new());
            writer.write_metadata(&mcap::records::Metadata { name, metadata }).unwrap();
        }
        let channel = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
        writer.write_to_known_channel(&header(channel, 1), b"before").unwrap();
        writer.write_to_known_channel(&header(channel, 2), b"mark").unwrap();
        writer.finish().unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        // Before the content are kind, length, channel, number and two times.
        let kind = whole.windows(4).position(|w| w == b"mark").unwrap() - 31;
        assert_eq!(whole[kind], op::MESSAGE);
        // Private records are skipped, except in recordings of Ballast, which have none.
        let miscounted = "1 messages in 1 chunks, where 2 in 1 were written".to_string();
        let stray = |kind| format!("a record of kind {kind:#04x} at a wrong place");
        let private = if ours { stray(0x86) } else { miscounted };
        let kinds = [0, 0x33, op::METADATA, op::CHUNK].map(|kind| (kind, stray(kind)));
        for (other, reason) in kinds.into_iter().chain([(0x86, private)]) {
            let mut bytes = whole.clone();
            bytes[kind] = other;
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(read(&path).unwrap().1, Some(reason), "ours: {ours}");
        }
    }
}

#[test]
fn messages_of_a_chunk_have_limited_memory() {
    let (_folder, path) = place("a.mcap");
    let file = std::fs::File::create(&path).unwrap();
    let options = mcap::WriteOptions::new().chunk_size(None).emit_message_indexes(false);
    let mut writer = options.create(std::io::BufWriter::new(file)).unwrap();
    let channel = writer.add_channel(0, "/a", "json", &BTreeMap::new()).unwrap();
    // 31 bytes each in the chunk, and twice as much in memory.
    (0..4_400_000).for_each(|_| writer.write_to_known_channel(&header(channel, 0), b"").unwrap());
    writer.finish().unwrap();
    drop(writer);
    let (times, lost) = read(&path).unwrap();
    assert!(times.is_empty());
    assert_eq!(lost.unwrap(), "a chunk whose messages take more than 268435456 bytes");
}

#[test]
fn other_files_and_versions_are_refused() {
    let (_folder, path) = place("a.mcap");
    for content in [&b""[..], b"not a recording", &[0x89, b'M', b'C', b'A', b'P', 0x30, 13, 10]] {
        std::fs::write(&path, content).unwrap();
        let error = MessageReader::open(&path).err().unwrap();
        assert!(matches!(error, Error::Damaged { .. }), "{error}");
    }
    let missing = path.with_file_name("none.mcap");
    assert!(matches!(MessageReader::open(&missing).err().unwrap(), Error::Io { .. }));

    write(&path, Some(&meta()));
    let mut bytes = std::fs::read(&path).unwrap();
    let key = b"\x06\0\0\0format\x01\0\0\x004";
    let at = bytes.windows(key.len()).position(|w| w == key).unwrap() + key.len() - 1;
    bytes[at] = b'9';
    std::fs::write(&path, bytes).unwrap();
    assert!(matches!(WindowReader::open(&path).err().unwrap(), Error::Version { .. }));
}

#[test]
fn a_text_with_a_wrong_length_is_refused() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let whole = std::fs::read(&path).unwrap();
    let at = |text: &[u8]| whole.windows(text.len()).position(|w| w == text).unwrap();
    // The header's profile, the metadata's name, a value in its map.
    for text in [&b"ros2"[..], b"ballast", b"synchronous"] {
        let length = at(&[&(text.len() as u32).to_le_bytes()[..], text].concat());
        let mut bytes = whole.clone();
        bytes[length..length + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        let message = match read(&path) {
            Ok((_, lost)) => lost.unwrap(),
            Err(error) => error.to_string(),
        };
        assert!(message.contains("a text that does not end within it"), "{message}");
    }
}

#[test]
fn an_attachment_without_its_checksum_is_refused() {
    let (_folder, path) = place("a.mcap");
    let mut writer = McapWriter::create(&path, Some(&meta())).unwrap();
    writer.attach("start.h5", 0, b"").unwrap();
    writer.finish().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let name = bytes.windows(8).position(|w| w == b"start.h5").unwrap();
    // Kind and length come before two times and the length of the name; at the end is the checksum.
    let length = name - 28..name - 20;
    let size = u64::from_le_bytes(bytes[length.clone()].try_into().unwrap());
    bytes[length].copy_from_slice(&(size - 4).to_le_bytes());
    bytes.drain(name - 20 + size as usize - 4..name - 20 + size as usize);
    std::fs::write(&path, bytes).unwrap();
    let (_, lost) = read(&path).unwrap();
    assert!(lost.unwrap().contains("a text that does not end within it"));
}

/// Writes zeros on a topic, more than a chunk may have, which compress to a small file; no window is complete.
fn bomb(path: &Path, topic: &str) {
    let mut writer = McapWriter::create(path, Some(&meta())).unwrap();
    let mut entry = TopicMessage::of(topic, 0, &Header::world(0)).unwrap();
    entry.bytes = vec![0; 8 << 20];
    (0..33).for_each(|_| writer.write(&entry).unwrap());
    writer.finish().unwrap();
}

#[test]
fn a_window_has_limited_memory_and_pictures_are_skipped() {
    let (_folder, path) = place("a.mcap");
    bomb(&path, "/body/pose");
    let error = WindowReader::open(&path).unwrap().next().unwrap_err();
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
    assert!(error.to_string().contains("/body/pose at 0 ns: expected a window of at most"));
    for aside in ["/stones", "/scene", "/log"] {
        bomb(&path, aside);
        let mut windows = WindowReader::open(&path).unwrap();
        assert!(windows.next().unwrap().is_none() && windows.truncation().is_none());
    }
}

#[test]
fn messages_after_the_last_window_are_an_error() {
    let (_folder, path) = place("a.mcap");
    write(&path, Some(&meta()));
    let error = WindowReader::open(&path).unwrap().next().unwrap_err();
    assert!(matches!(error, Error::Damaged { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("/body_0/pose at 0 ns: expected a window of it"), "{message}");
    // In a truncated file they are the lost rest.
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() * 2 / 3]).unwrap();
    let mut windows = WindowReader::open(&path).unwrap();
    assert!(windows.next().unwrap().is_none() && windows.truncation().is_some());
}

#[test]
fn names_have_limited_memory() {
    let (_folder, path) = place("a.mcap");
    let file = std::fs::File::create(&path).unwrap();
    let options = mcap::WriteOptions::new().chunk_size(Some(1 << 20));
    let mut writer = options.create(std::io::BufWriter::new(file)).unwrap();
    for i in 0..34 {
        let topic = format!("/{i}{}", "a".repeat(8 << 20));
        let channel = writer.add_channel(0, &topic, "json", &BTreeMap::new()).unwrap();
        writer.write_to_known_channel(&header(channel, i), b"{}").unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let (times, lost) = read(&path).unwrap();
    assert!(times.len() < 34 && lost.unwrap().contains("bytes of names"), "{times:?}");
}
