// Memory for large arrays that are read sequentially, in large pages where the operating system grants them.
#pragma once

#include <cstddef>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace omnimirror {

// An array of many megabytes is read once per image. With 4 kB pages, this causes thousands of address translations,
// which cost more than the reads on virtual machines.
template <class T>
struct LargePages {
    using value_type = T;
    static constexpr size_t PAGE = size_t{1} << 21;

    LargePages() = default;
    template <class U>
    LargePages(const LargePages<U>&) {}

    T* allocate(size_t count) {
        const size_t bytes = count * sizeof(T);
        if (bytes < PAGE) return static_cast<T*>(::operator new(bytes));
        const size_t size = (bytes + PAGE - 1) / PAGE * PAGE;
        void* memory = ::operator new(size, std::align_val_t{PAGE});
#ifdef MADV_HUGEPAGE
        madvise(memory, size, MADV_HUGEPAGE);  // if refused, everything works without large pages
#endif
        return static_cast<T*>(memory);
    }

    void deallocate(T* memory, size_t count) {
        if (count * sizeof(T) < PAGE)
            ::operator delete(memory);
        else
            ::operator delete(memory, std::align_val_t{PAGE});
    }

    friend bool operator==(const LargePages&, const LargePages&) { return true; }
};

}  // namespace omnimirror
