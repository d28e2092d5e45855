//! Description of a unit after FMI 3.0: arrays, the same as scalars, and a terminal for each body.

use crate::bed::UnitBed;
use crate::description::{
    Attributes, BedPlace, MODEL_IDENTIFIER, TOOL, XmlWriter, default_experiment, document, element,
    empty, has_start, log_categories, start, summary, units, usage, whole,
};
use crate::variable_table::VariableTable;
use crate::variables::{INPUT_TIMES, TIME, ValueType, Variable, VariableUse, scalar_reference};
use std::collections::BTreeMap;
use std::io;

/// Name of the type of `inputs_at`.
const INPUT_TIME_TYPE_NAME: &str = "InputTime";

/// Returns `modelDescription.xml`.
pub(crate) fn model_description(
    bed: &UnitBed,
    table: &VariableTable,
    token: &str,
    place: BedPlace,
) -> io::Result<Vec<u8>> {
    let attributes = vec![
        ("fmiVersion", "3.0".into()),
        ("modelName", bed.name.clone()),
        ("instantiationToken", token.into()),
        ("description", summary(bed, place)),
        ("generationTool", TOOL.into()),
        ("variableNamingConvention", "structured".into()),
    ];
    document("fmiModelDescription", attributes, |xml| {
        let yes = || "true".to_string();
        let abilities = vec![
            ("modelIdentifier", MODEL_IDENTIFIER.into()),
            ("needsExecutionTool", place.is_served().to_string()),
            ("canBeInstantiatedOnlyOncePerProcess", place.is_served().to_string()),
            ("canGetAndSetFMUState", yes()),
            ("canSerializeFMUState", (!place.is_served()).to_string()),
            ("canHandleVariableCommunicationStepSize", yes()),
            ("fixedInternalStepSize", bed.model.stepping.h().to_string()),
            ("mightReturnEarlyFromDoStep", yes()),
        ];
        empty(xml, "CoSimulation", abilities)?;
        units(xml)?;
        element(xml, "TypeDefinitions", vec![], |xml| {
            element(
                xml,
                "EnumerationType",
                vec![("name", INPUT_TIME_TYPE_NAME.into())],
                input_times,
            )
        })?;
        log_categories(xml)?;
        default_experiment(xml, bed)?;
        element(xml, "ModelVariables", vec![], |xml| {
            let time = vec![
                ("name", "time".into()),
                ("valueReference", TIME.to_string()),
                ("causality", "independent".into()),
                ("variability", "continuous".into()),
                ("unit", "s".into()),
            ];
            empty(xml, "Float64", time)?;
            for variable in &table.variables {
                if variable.count > 1 {
                    array(xml, variable)?;
                }
                (0..variable.count).try_for_each(|k| scalar(xml, variable, k))?;
            }
            Ok(())
        })?;
        element(xml, "ModelStructure", vec![], |xml| {
            for name in ["Output", "InitialUnknown"] {
                for reference in outputs(table) {
                    let reference = reference.to_string();
                    let attributes =
                        vec![("valueReference", reference), ("dependencies", String::new())];
                    empty(xml, name, attributes)?;
                }
            }
            Ok(())
        })
    })
}

/// Returns the value references of all outputs, which depend on no input at the same time.
fn outputs(table: &VariableTable) -> Vec<u32> {
    let outputs = table.variables.iter().filter(|v| v.usage == VariableUse::Output);
    outputs
        .flat_map(|v| {
            let array = (v.count > 1).then(|| v.reference());
            array.into_iter().chain(v.elements().map(scalar_reference))
        })
        .collect()
}

fn array(xml: &mut XmlWriter, variable: &Variable) -> io::Result<()> {
    let (name, reference) = (variable.name.clone(), variable.reference());
    let (tag, attributes) = variable_attributes(variable, name, reference, &variable.start);
    element(xml, tag, attributes, |xml| {
        empty(xml, "Dimension", vec![("start", variable.count.to_string())])
    })
}

fn scalar(xml: &mut XmlWriter, variable: &Variable, k: usize) -> io::Result<()> {
    let (name, reference) = (variable.scalar_name(k), scalar_reference(variable.first + k));
    let (tag, attributes) = variable_attributes(variable, name, reference, &variable.start[k..=k]);
    empty(xml, tag, attributes)
}

fn variable_attributes<'a>(
    variable: &Variable,
    name: String,
    reference: u32,
    values: &[f64],
) -> (&'static str, Attributes<'a>) {
    let mut attributes = vec![
        ("name", name),
        ("valueReference", reference.to_string()),
        ("description", variable.description.clone()),
    ];
    attributes.extend(usage(variable));
    let (tag, text) = match variable.kind {
        ValueType::Real => ("Float64", start(values)),
        ValueType::Integer => ("Int32", whole(values[0])),
        ValueType::InputTime => {
            attributes.push(("declaredType", INPUT_TIME_TYPE_NAME.into()));
            ("Enumeration", whole(values[0]))
        }
        ValueType::Text => ("String", String::new()),
    };
    if !variable.unit.is_empty() {
        attributes.push(("unit", variable.unit.clone()));
    }
    if has_start(variable) {
        attributes.push(("start", text));
    }
    (tag, attributes)
}

/// Returns `terminalsAndIcons.xml`: one terminal for each body and zone, with the arrays as members.
pub(crate) fn terminals(table: &VariableTable) -> io::Result<Vec<u8>> {
    let mut groups: BTreeMap<&str, Vec<(&str, &Variable)>> = BTreeMap::new();
    for variable in &table.variables {
        let is_signal = matches!(variable.usage, VariableUse::Input | VariableUse::Output);
        if let Some((group, member)) = variable.name.rsplit_once('.').filter(|_| is_signal) {
            groups.entry(group).or_default().push((member, variable));
        }
    }
    let root = vec![("fmiVersion", "3.0".into())];
    document("fmiTerminalsAndIcons", root, |xml| {
        element(xml, "Terminals", vec![], |xml| {
            for (group, members) in &groups {
                let attributes = vec![("name", (*group).into()), ("matchingRule", "plug".into())];
                element(xml, "Terminal", attributes, |xml| {
                    for (member, variable) in members {
                        let attributes = vec![
                            ("variableName", variable.name.clone()),
                            ("variableKind", "signal".into()),
                            ("memberName", (*member).into()),
                        ];
                        empty(xml, "TerminalMemberVariable", attributes)?;
                    }
                    Ok(())
                })?;
            }
            Ok(())
        })
    })
}

/// Writes the values of the type of `inputs_at`.
fn input_times(xml: &mut XmlWriter) -> io::Result<()> {
    for (k, (name, description)) in INPUT_TIMES.iter().enumerate() {
        let value = (k + 1).to_string();
        let attributes = vec![
            ("name", (*name).into()),
            ("value", value),
            ("description", (*description).into()),
        ];
        empty(xml, "Item", attributes)?;
    }
    Ok(())
}
