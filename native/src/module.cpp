// The Python module omnimirror.base._native, loaded by omnimirror.base.native: functions of all folders, and the number
// of threads.
#include "bindings.hpp"
#include "pool.hpp"

NB_MODULE(_native, m) {
    using namespace omnimirror;
#ifdef NDEBUG
    // Objects alive when an exception ends the process are not leaks, and a report of them would hide the error
    // message.
    nb::set_leak_warnings(false);
#endif
    m.doc() = "The compiled kernels of omnimirror; see native/README.md.";
    m.attr("INTERFACE") = 17;  // increment with every change of names or arguments; checked by omnimirror.base.native
    add_sampling(m);
    add_designs(m);
    add_exposure(m);
    add_surfaces(m);
    add_deconvolution(m);
    add_tolerancing(m);
    add_reflection(m);
    m.def(
        "set_threads",
        [](int count) {
            set_threads(checked(count, "threads", 1, 1024));
        },
        "count"_a);
    m.def("get_threads", &get_threads);
}
