//! Bytes as the standard has them.

use crate::messages::{
    AdvanceRequest, BodyMotion, Header, PointCloud2, PointField, ReplyStatus, TFMessage, Time,
};
use crate::{from_cdr, to_cdr};

/// `std_msgs/Header` with a text of two letters, as other writers of ROS 2 leave it.
const HEADER: [u8; 19] = [0, 1, 0, 0, 5, 0, 0, 0, 7, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0];

fn header() -> Header {
    Header { stamp: Time { sec: 5, nanosec: 7 }, frame_id: "ab".into() }
}

#[test]
fn bytes_are_those_of_the_standard() {
    assert_eq!(to_cdr(&header()).unwrap(), HEADER);
    assert_eq!(from_cdr::<Header>(&HEADER).unwrap(), header());
    // Numbers are aligned relative to the byte after the header of four.
    let input = BodyMotion { body: "t".into(), ..BodyMotion::default() };
    let bytes = to_cdr(&input).unwrap();
    let expected = [0, 1, 0, 0, 2, 0, 0, 0, b't', 0, 2, 0, 0, 0, 0, 0];
    assert_eq!(bytes, expected, "text, byte, byte, length at 8");
    let request = AdvanceRequest { seq: 0x0102, t1_ns: -1, ..AdvanceRequest::default() };
    let bytes = to_cdr(&request).unwrap();
    // An empty text is a zero alone; then seven bytes to the next number of eight.
    assert_eq!(bytes[4..12], [1, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes[12..20], [2, 1, 0, 0, 0, 0, 0, 0]);
    assert_eq!(bytes[28..36], [255; 8]);
}

#[test]
fn the_other_order_of_bytes_is_read() {
    let bytes = [0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 7, 0, 0, 0, 3, b'a', b'b', 0];
    assert_eq!(from_cdr::<Header>(&bytes).unwrap(), header());
}

#[test]
fn a_last_word_may_be_filled_with_zeros() {
    let filled = [&HEADER[..], &[0]].concat();
    assert_eq!(from_cdr::<Header>(&filled).unwrap(), header());
    for rest in [&[1][..], &[0, 0], &[0; 5]] {
        let error = from_cdr::<Header>(&[&HEADER[..], rest].concat()).unwrap_err();
        assert_eq!(error.expected, "the end of the message");
    }
}

#[test]
fn an_empty_text_without_its_zero_is_read() {
    let bytes = [0, 1, 0, 0, 5, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
    assert_eq!(from_cdr::<Header>(&bytes).unwrap().frame_id, "");
}

#[test]
fn what_is_wrong_is_told_with_its_place() {
    let broken = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = HEADER.to_vec();
        change(&mut bytes);
        from_cdr::<Header>(&bytes).unwrap_err().to_string()
    };
    assert_eq!(
        broken(&|b| b.truncate(10)),
        "std_msgs/msg/Header.stamp.nanosec, byte 8: expected 4 more bytes, found 2 bytes"
    );
    assert_eq!(
        broken(&|b| b[15] = 0x80),
        "std_msgs/msg/Header.frame_id, byte 16: expected a length of at most 3, the bytes left, found \
         a length of 2147483651"
    );
    assert!(broken(&|b| b[16] = 0xff).contains("frame_id, byte 19: expected a text in UTF-8"));
    assert!(broken(&|b| b[18] = b'c').contains("expected a text that ends with a zero"));
    assert!(broken(&|b| b[16] = 0).contains("expected a text without zeros"));
    assert!(broken(&|b| b[1] = 3).contains("header of plain CDR"));
    assert!(broken(&|b| b.truncate(3)).contains("found 3 bytes"));
}

#[test]
fn lengths_that_the_bytes_cannot_hold_are_refused_at_once() {
    let hostile = [0, 1, 0, 0, 0, 0, 0, 0x80];
    let error = from_cdr::<TFMessage>(&hostile).unwrap_err();
    assert_eq!(error.found, "a length of 2147483648");
    let many = PointField { name: "x".into(), ..PointField::default() };
    let cloud = PointCloud2 { fields: vec![many; 3], data: vec![1, 2, 3], ..Default::default() };
    let bytes = to_cdr(&cloud).unwrap();
    assert_eq!(from_cdr::<PointCloud2>(&bytes).unwrap(), cloud);
}

#[test]
fn values_that_a_type_does_not_know_are_refused() {
    let mut bytes = to_cdr(&BodyMotion { body: "t".into(), ..BodyMotion::default() }).unwrap();
    bytes[10] = 9;
    let error = from_cdr::<BodyMotion>(&bytes).unwrap_err();
    assert!(error.place.contains("BodyMotion.interpolation"), "{error}");
    assert!(error.expected.contains("hermite (2)") && error.found.contains('9'), "{error}");
    bytes[10] = 0;
    bytes[11] = 2;
    assert!(from_cdr::<BodyMotion>(&bytes).unwrap_err().to_string().contains("allow_jump"));
    assert_eq!(ReplyStatus::ALL.len(), 6);
}

#[test]
fn a_text_with_a_zero_is_not_written() {
    let header = Header { frame_id: "a\0b".into(), ..Header::default() };
    let error = to_cdr(&header).unwrap_err();
    assert!(error.to_string().contains("Header.frame_id"), "{error}");
}
