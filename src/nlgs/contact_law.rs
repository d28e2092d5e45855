//! (plain law: to come)
