// omnimirror.base._native, as omnimirror.base.native opens it: what each room brings, and the threads of all.
#include "bindings.hpp"
#include "pool.hpp"

NB_MODULE(_native, m) {
    using namespace omnimirror;
#ifdef NDEBUG
    // What a process keeps when an exception ends it is not lost, and its list would hide the sentence that says why.
    nb::set_leak_warnings(false);
#endif
    m.doc() = "The compiled kernels of omnimirror; see native/README.md.";
    m.attr("INTERFACE") = 16;  // one more when a name or an argument changes; omnimirror.base.native asks for the same
    add_sampling(m);
    add_designs(m);
    add_exposure(m);
    add_surfaces(m);
    add_deblurring(m);
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
