//! Description of a unit after FMI 2.0: scalars only.

use crate::bed::UnitBed;
use crate::description::{
    Attributes, BedPlace, MODEL_IDENTIFIER, TOOL, XmlWriter, default_experiment, document, element,
    empty, has_start, log_categories, start, summary, units, usage, whole,
};
use crate::variable_table::VariableTable;
use crate::variables::{INPUT_TIMES, ValueType, Variable, VariableUse, scalar_reference};
use std::io;

/// Returns `modelDescription.xml`.
pub(crate) fn model_description(
    bed: &UnitBed,
    table: &VariableTable,
    token: &str,
    place: BedPlace,
) -> io::Result<Vec<u8>> {
    let attributes = vec![
        ("fmiVersion", "2.0".into()),
        ("modelName", bed.name.clone()),
        ("guid", token.into()),
        ("description", summary(bed, place)),
        ("generationTool", TOOL.into()),
        ("variableNamingConvention", "structured".into()),
        ("numberOfEventIndicators", "0".into()),
    ];
    document("fmiModelDescription", attributes, |xml| {
        let yes = || "true".to_string();
        let abilities = vec![
            ("modelIdentifier", MODEL_IDENTIFIER.into()),
            ("needsExecutionTool", place.is_served().to_string()),
            ("canHandleVariableCommunicationStepSize", yes()),
            ("canBeInstantiatedOnlyOncePerProcess", place.is_served().to_string()),
            ("canNotUseMemoryManagementFunctions", yes()),
            ("canGetAndSetFMUstate", yes()),
            ("canSerializeFMUstate", (!place.is_served()).to_string()),
        ];
        empty(xml, "CoSimulation", abilities)?;
        units(xml)?;
        log_categories(xml)?;
        default_experiment(xml, bed)?;
        element(xml, "ModelVariables", vec![], |xml| {
            for variable in &table.variables {
                (0..variable.count).try_for_each(|k| scalar(xml, variable, k))?;
            }
            Ok(())
        })?;
        element(xml, "ModelStructure", vec![], |xml| {
            element(xml, "Outputs", vec![], |xml| unknowns(xml, table))?;
            element(xml, "InitialUnknowns", vec![], |xml| unknowns(xml, table))
        })
    })
}

fn scalar(xml: &mut XmlWriter, variable: &Variable, k: usize) -> io::Result<()> {
    let mut attributes = vec![
        ("name", variable.scalar_name(k)),
        ("valueReference", scalar_reference(variable.first + k).to_string()),
        ("description", variable.description.clone()),
    ];
    attributes.extend(usage(variable));
    element(xml, "ScalarVariable", attributes, |xml| {
        let value = variable.start[k];
        let mut of_type: Attributes = Vec::new();
        let (name, text) = match variable.kind {
            ValueType::Real => ("Real", start(&[value])),
            ValueType::Integer => ("Integer", whole(value)),
            // Importers without enumerations can set an integer; the calls are the same.
            ValueType::InputTime => {
                of_type.push(("min", "1".into()));
                of_type.push(("max", INPUT_TIMES.len().to_string()));
                ("Integer", whole(value))
            }
            ValueType::Text => ("String", String::new()),
        };
        if !variable.unit.is_empty() {
            of_type.push(("unit", variable.unit.clone()));
        }
        if has_start(variable) {
            of_type.push(("start", text));
        }
        empty(xml, name, of_type)
    })
}

/// Writes the outputs: none depends on an input at the same time.
fn unknowns(xml: &mut XmlWriter, table: &VariableTable) -> io::Result<()> {
    for variable in table.variables.iter().filter(|v| v.usage == VariableUse::Output) {
        for element in variable.elements() {
            // Numbers of variables are counted from 1.
            let index = (element + 1).to_string();
            empty(xml, "Unknown", vec![("index", index), ("dependencies", String::new())])?;
        }
    }
    Ok(())
}
