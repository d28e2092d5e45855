//! Files of Ballast: what is written is read, what is damaged is refused.

mod checkpoint;
mod damage;
mod fclib;
mod fclib_broken;
mod inspect;
mod results;
mod scene;
