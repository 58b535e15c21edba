// Test of the thread pool with tasks that throw, nested calls, and several calling threads; also run with the thread
// sanitizer. Exits with 1 if the behaviour differs from the description in pool.hpp.
#include "pool.hpp"

#include <atomic>
#include <cstdio>
#include <functional>
#include <new>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

using namespace omnimirror;

namespace {

int failures = 0;

void expect(bool condition, const char* what) {
    if (condition) return;
    std::printf("pool: %s\n", what);
    ++failures;
}

void each(int count, const std::function<void(int)>& task) {
    parallel_for(
        count, [](void* context, int i) { (*static_cast<const std::function<void(int)>*>(context))(i); },
        const_cast<std::function<void(int)>*>(&task));
}

bool sums_are_right(int count) {
    std::atomic<long> sum{0};
    each(count, [&](int i) { sum += i; });
    return sum == static_cast<long>(count) * (count - 1) / 2;
}

void test_errors(int threads) {
    set_threads(threads);
    for (int round = 0; round < 300; ++round) {
        const int count = 1 + round % 64, wrong = round % count;
        std::atomic<int> running{0}, done{0};
        std::string message;
        try {
            each(count, [&](int i) {
                ++running;
                if (i == wrong || round % 3 == 0) {
                    --running;
                    throw std::runtime_error("task");
                }
                std::this_thread::yield();
                ++done, --running;
            });
        } catch (const std::runtime_error& error) {
            message = error.what();
        }
        expect(message == "task", "an exception of a task must reach the caller");
        expect(running == 0, "tasks must have ended when the caller goes on");
        expect(done < count, "the task that failed is not done");
        expect(sums_are_right(100), "the pool must work after an exception");
    }
    bool has_no_memory = false;
    try {
        each(64, [](int) { throw std::bad_alloc(); });
    } catch (const std::bad_alloc&) {
        has_no_memory = true;
    }
    expect(has_no_memory, "the type of an exception must be kept");
}

void test_cancellation() {
    set_threads(4);
    std::atomic<int> begun{0};
    try {
        each(1 << 20, [&](int) {
            ++begun;
            throw std::runtime_error("task");
        });
    } catch (const std::runtime_error&) {
    }
    expect(begun <= 4, "tasks must not begin after one has failed on every thread");
}

void test_nesting() {
    set_threads(4);
    std::atomic<long> sum{0};
    each(16, [&](int) { each(16, [&](int i) { sum += i; }); });
    expect(sum == 16 * 120, "tasks must be able to call the pool");
    int caught = 0;
    try {
        each(16, [&](int) { each(16, [&](int) { throw std::runtime_error("inner"); }); });
    } catch (const std::runtime_error&) {
        ++caught;
    }
    expect(caught == 1, "an exception must pass both levels");
}

void test_callers() {
    set_threads(3);
    std::atomic<int> wrong{0}, caught{0};
    std::vector<std::thread> callers;
    for (int c = 0; c < 4; ++c)
        callers.emplace_back([&, c] {
            for (int round = 0; round < 200; ++round) {
                wrong += !sums_are_right(50 + round);
                try {
                    each(20, [&](int i) {
                        if (c % 2 && i == 7) throw std::runtime_error("task");
                    });
                } catch (const std::runtime_error&) {
                    ++caught;
                }
            }
        });
    for (std::thread& caller : callers) caller.join();
    expect(wrong == 0, "sums of several callers must be right");
    expect(caught == 2 * 200, "exceptions must reach the caller whose task has thrown them, and no other");
}

}  // namespace

int main() {
    for (const int threads : {1, 2, 4}) test_errors(threads);
    test_cancellation();
    test_nesting();
    test_callers();
    if (!failures) std::printf("pool: exceptions, nested calls and several callers as expected\n");
    return failures != 0;
}
