//! Contacts against an exact oracle, and what detection promises: canonical order, no memory of the
//! past in its results, the same bytes for any number of threads.

mod json;
mod oracle;
mod scene;

mod exactness;
mod manifolds;
mod matching;
mod promises;
mod samples;
mod steep_face;
