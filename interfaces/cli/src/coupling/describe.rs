//! `ballast describe SITE/ID`: description of a served component.

use super::args::DescribeArgs;
use crate::console::Console;
use ballast_protocol::lockstep::ErrorCode;
use ballast_session::{Reporter, Result};
use ballast_zenoh::{ComponentDescription, Connection, HEARTBEAT_INTERVAL, Timeouts};
use serde_json::json;

pub fn describe(args: DescribeArgs, console: Console) -> Result {
    let connection =
        Connection::open(&args.key, &args.endpoints.to_connect(), Timeouts::default())?;
    if args.schema {
        let schema = connection.schema()?;
        console.result(&format!("{schema:#}"));
        console.event("schema", json!({ "schema": schema }));
        return Ok(());
    }
    let mut is_reported = false;
    let description = loop {
        match connection.describe() {
            Err(error) if error.request_error().is_some_and(|f| f.code == ErrorCode::Preparing) => {
                if !std::mem::replace(&mut is_reported, true) {
                    console.note("the bed is being prepared; waiting for it");
                }
                std::thread::sleep(HEARTBEAT_INTERVAL);
            }
            result => break result?,
        }
    };
    console.event("component", json!(description));
    console.result(&text(&description));
    Ok(())
}

fn text(d: &ComponentDescription) -> String {
    let step_ms = d.step_ns as f64 / 1e6;
    let lines = [
        ("component", d.key.clone()),
        ("program", format!("ballast {}, messages {}", d.version, d.protocol_version)),
        ("time step", format!("{step_ms} ms; windows are multiples of it")),
        ("grains", d.grains.to_string()),
        ("units", d.units.clone()),
        ("frame", d.frame.clone()),
        ("wrench", d.wrench_convention.clone()),
        (
            "windows join",
            format!(
                "within {:.0e} m, {:.0e} rad, {:.0e} m/s, {:.0e} rad/s",
                d.continuity.distance_m,
                d.continuity.angle_rad,
                d.continuity.speed,
                d.continuity.angular_velocity
            ),
        ),
        ("same inputs", d.determinism.clone()),
    ];
    let lines = lines.map(|(label, value)| format!("{label:<16}{value}"));
    let pictures = match &d.viewer_endpoints[..] {
        [] => String::new(),
        all => format!("\n{:<16}{}", "pictures", all.join(", ")),
    };
    let parameters: Vec<_> = d.parameters.iter().map(|(k, v)| format!("{k} {v}")).collect();
    let mut text =
        format!("{}{pictures}\n{:<16}{}", lines.join("\n"), "parameters", parameters.join(", "));
    for body in &d.bodies {
        let p = body.position;
        let freedoms = match &body.dof_modes {
            all if all.iter().all(|f| *f == all[0]) => all[0].clone(),
            each => each.join(" "),
        };
        text += &format!(
            "\nbody            {:<20} {:<9} at {:.4} {:.4} {:.4} m, {freedoms}",
            body.name, body.role, p.x, p.y, p.z
        );
    }
    for tine in &d.tines {
        text += &format!(
            "\ntine            {:<20} pair {}, closes {:+.0} x by {:.4} m, full depth at z {:.4} m",
            tine.body, tine.pair, tine.direction, tine.stroke, tine.full_depth_z
        );
    }
    text
}
