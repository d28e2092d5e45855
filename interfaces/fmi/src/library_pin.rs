//! Pin of the library in the process, for as long as threads of Zenoh may run its code.
//!
//! An importer may unload the library after the last instance, but Zenoh's threads never end: they would continue in unmapped
//! memory. A pinned library stays until the process ends. Units with their bed inside do not pin.

use std::ffi::c_void;
use std::mem::MaybeUninit;
use std::sync::Once;

/// Pins the library that contains this function.
pub(crate) fn pin_library() {
    static PINNED: Once = Once::new();
    PINNED.call_once(|| {
        let mut found = MaybeUninit::<libc::Dl_info>::zeroed();
        let address = pin_library as fn() as *const c_void;
        // SAFETY: the address is that of a function of this library, and `found` has room for the answer. The name in it
        // lives as long as the library. A program that contains this code is found by no such name, and needs no pin.
        unsafe {
            if libc::dladdr(address, found.as_mut_ptr()) != 0 {
                let flags = libc::RTLD_LAZY | libc::RTLD_NOLOAD | libc::RTLD_NODELETE;
                libc::dlopen(found.assume_init().dli_fname, flags);
            }
        }
    });
}
