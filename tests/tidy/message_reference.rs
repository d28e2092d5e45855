//! The reference page of messages, generated from their `.msg` definitions.

use crate::tree;

const PAGE: &str = "docs/src/reference/messages.md";
const FOLDER: &str = "interfaces/protocol/msg/ballast_msgs";

fn page() -> String {
    let mut text = String::from(
        "# Messages\n\n\
        Generated from `interfaces/protocol/msg/ballast_msgs`; `make docs` writes this page.\n\n\
        Messages on the wire and in recordings are CDR (XCDR1, little endian) with these ROS 2 definitions. SI units, \
        world axes, z up;\nquaternions x, y, z, w. A comment describes the fields below it. Recordings also use stock \
        messages of ROS 2 and\nFoxglove, whose definitions are in `interfaces/protocol/msg`.\n",
    );
    for file in tree::files(FOLDER, &["msg"]) {
        let name = file.path.trim_start_matches(FOLDER).trim_matches('/').trim_end_matches(".msg");
        text += &format!("\n## {name}\n\n```text\n{}\n```\n", file.text.trim_end());
    }
    text
}

#[test]
fn the_reference_of_messages_is_current() {
    if std::env::var_os("BALLAST_WRITE_DOCS").is_some() {
        std::fs::write(tree::root().join(PAGE), page()).expect(PAGE);
    }
    assert!(
        tree::read(PAGE) == page(),
        "{PAGE}: expected the present definitions; run `make docs`"
    );
}
