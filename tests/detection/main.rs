//! Contacts against an exact oracle, and guarantees of detection: canonical order, results independent of
//! the past, equal results for any number of threads.

mod json;
mod oracle;
mod scene;

mod covered;
mod exactness;
mod manifolds;
mod matching;
mod promises;
mod samples;
mod steep_face;
