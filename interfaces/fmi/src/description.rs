//! Parts of a description that both versions of FMI share.

use crate::bed::UnitBed;
use crate::logger::CATEGORIES;
use crate::variables::{Variable, VariableUse};
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, Event};
use std::io;

/// Name of the library without its ending (`modelIdentifier`).
pub(crate) const MODEL_IDENTIFIER: &str = "ballast_fmu";
/// Name of the program in descriptions.
pub(crate) const TOOL: &str = concat!("Ballast ", env!("CARGO_PKG_VERSION"));

/// Writer of a description.
pub(crate) type XmlWriter = Writer<Vec<u8>>;
/// Attributes of an element.
pub(crate) type Attributes<'a> = Vec<(&'a str, String)>;

/// Units with the exponents of kg, m, s and rad.
const UNITS: [(&str, [(&str, i8); 4]); 8] = [
    ("s", [("kg", 0), ("m", 0), ("s", 1), ("rad", 0)]),
    ("m", [("kg", 0), ("m", 1), ("s", 0), ("rad", 0)]),
    ("m/s", [("kg", 0), ("m", 1), ("s", -1), ("rad", 0)]),
    ("rad/s", [("kg", 0), ("m", 0), ("s", -1), ("rad", 1)]),
    ("N", [("kg", 1), ("m", 1), ("s", -2), ("rad", 0)]),
    ("N.m", [("kg", 1), ("m", 2), ("s", -2), ("rad", 0)]),
    ("J", [("kg", 1), ("m", 2), ("s", -2), ("rad", 0)]),
    ("Pa", [("kg", 1), ("m", -1), ("s", -2), ("rad", 0)]),
];

/// Returns a document whose root has the attributes and the content that `fill` writes.
pub(crate) fn document(
    root: &str,
    attributes: Attributes,
    fill: impl FnOnce(&mut XmlWriter) -> io::Result<()>,
) -> io::Result<Vec<u8>> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    element(&mut xml, root, attributes, fill)?;
    Ok(xml.into_inner())
}

/// Writes an element with the content that `fill` writes.
pub(crate) fn element(
    xml: &mut XmlWriter,
    name: &str,
    attributes: Attributes,
    fill: impl FnOnce(&mut XmlWriter) -> io::Result<()>,
) -> io::Result<()> {
    let attributes = attributes.iter().map(|(key, value)| (*key, &value[..]));
    xml.create_element(name).with_attributes(attributes).write_inner_content(fill)?;
    Ok(())
}

/// Writes an element without content.
pub(crate) fn empty(xml: &mut XmlWriter, name: &str, attributes: Attributes) -> io::Result<()> {
    let attributes = attributes.iter().map(|(key, value)| (*key, &value[..]));
    xml.create_element(name).with_attributes(attributes).write_empty()?;
    Ok(())
}

/// Writes the definitions of units.
pub(crate) fn units(xml: &mut XmlWriter) -> io::Result<()> {
    element(xml, "UnitDefinitions", vec![], |xml| {
        for (name, base) in UNITS {
            element(xml, "Unit", vec![("name", name.into())], |xml| {
                let exponents = base.iter().filter(|(_, exponent)| *exponent != 0);
                empty(xml, "BaseUnit", exponents.map(|&(u, e)| (u, e.to_string())).collect())
            })?;
        }
        Ok(())
    })
}

/// Writes the categories of messages.
pub(crate) fn log_categories(xml: &mut XmlWriter) -> io::Result<()> {
    element(xml, "LogCategories", vec![], |xml| {
        for category in CATEGORIES {
            let name = category.to_string_lossy().into_owned();
            empty(xml, "Category", vec![("name", name)])?;
        }
        Ok(())
    })
}

/// Writes the default experiment: the length of the case's run in its time steps.
pub(crate) fn default_experiment(xml: &mut XmlWriter, bed: &UnitBed) -> io::Result<()> {
    let stop = bed.duration_ns as f64 * 1e-9;
    let attributes = vec![
        ("startTime", "0".into()),
        ("stopTime", stop.to_string()),
        ("stepSize", bed.model.stepping.h().to_string()),
    ];
    empty(xml, "DefaultExperiment", attributes)
}

/// Place of a unit's bed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BedPlace<'a> {
    /// Inside the unit.
    Unit,
    /// At the component of this name, `site/id`.
    Server(&'a str),
}

impl BedPlace<'_> {
    /// Returns true if the unit needs a server.
    pub fn is_served(self) -> bool {
        self != Self::Unit
    }
}

/// Returns the description of a unit.
pub(crate) fn summary(bed: &UnitBed, place: BedPlace) -> String {
    let place = match place {
        BedPlace::Unit => String::new(),
        BedPlace::Server(component) => {
            format!(", computed by the component {component} of `ballast serve`")
        }
    };
    format!(
        "Bed of {} ballast grains{place}; SI units, world axes with z up, forces by the ballast on the bodies. Its bodies \
         follow the inputs: the tamping cycle of the case does not run",
        bed.model.grains.len()
    )
}

/// Returns causality and variability of a variable, and `initial` where it is not the default.
pub(crate) fn usage(variable: &Variable) -> Attributes<'static> {
    use crate::variables::ValueType::Real;
    let (causality, variability, initial) = match variable.usage {
        VariableUse::Input => ("input", "continuous", None),
        VariableUse::Output if variable.kind == Real => {
            ("output", "continuous", Some("calculated"))
        }
        VariableUse::Output => ("output", "discrete", Some("calculated")),
        VariableUse::Fixed => ("parameter", "fixed", Some("exact")),
        VariableUse::Tunable => ("parameter", "tunable", Some("exact")),
        VariableUse::Constant => ("local", "constant", Some("exact")),
        VariableUse::Local => ("local", "discrete", Some("calculated")),
    };
    let mut attributes = vec![("causality", causality.into()), ("variability", variability.into())];
    attributes.extend(initial.map(|initial: &str| ("initial", initial.into())));
    attributes
}

/// Returns true for a variable with a value in the description; the instance computes the others.
pub(crate) fn has_start(variable: &Variable) -> bool {
    !matches!(variable.usage, VariableUse::Output | VariableUse::Local)
}

/// Returns the values of a variable as a list in the shortest form that gives the same bits.
pub(crate) fn start(values: &[f64]) -> String {
    values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(" ")
}

/// Returns a whole number as text.
pub(crate) fn whole(value: f64) -> String {
    (value as i64).to_string()
}
