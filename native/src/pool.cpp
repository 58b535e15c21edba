#include "pool.hpp"

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

#ifndef _WIN32
#include <pthread.h>
#endif

namespace omnimirror {
namespace {

class Pool {
  public:
    void run(int count, int helpers, Task task, void* context) {
        // No mutex: a task that calls this function may run on the thread that already owns it.
        if (busy_.exchange(true, std::memory_order_acquire)) return run_alone(count, task, context);
        const Release release{busy_};
        helpers = start(helpers);
        {
            std::lock_guard lock(mutex_);
            task_ = task, context_ = context, count_ = count, next_ = 0;
            requested_ = helpers;
        }
        wake_.notify_one();  // each thread wakes the next one, so that this thread starts to work immediately
        work();
        {
            // Do not wait for helpers that have not woken yet: no tasks are left for them.
            std::lock_guard lock(mutex_);
            requested_ = 0;
        }
        wait_for_helpers();
        if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
    }

    static void run_alone(int count, Task task, void* context) {
        for (int i = 0; i < count; ++i) task(context, i);
    }

  private:
    struct Release {
        std::atomic<bool>& busy;
        ~Release() { busy.store(false, std::memory_order_release); }
    };

    // Start threads on first use. If the operating system refuses, by its limit of threads or memory, fewer threads
    // work.
    int start(int helpers) {
        while (started_ < helpers) {
            try {
                std::thread(&Pool::serve, this).detach();
            } catch (const std::exception&) {  // system_error or bad_alloc
                return started_;
            }
            ++started_;
        }
        return helpers;
    }

    void serve() {
        // The library allocates the exception state of a thread at first use, and aborts if it cannot: allocate it now,
        // before memory runs out.
        (void)std::uncaught_exceptions();
        std::unique_lock lock(mutex_);
        for (;;) {
            wake_.wait(lock, [this] { return requested_ > 0; });
            ++active_;
            const bool more = --requested_ > 0;
            lock.unlock();
            if (more) wake_.notify_one();
            work();
            lock.lock();
            if (--active_ == 0) done_.notify_one();
        }
    }

    // The helpers are finishing their last tasks: spin first, because sleeping would take longer than they need.
    void wait_for_helpers() {
        for (int i = 0; i < SPINS && active_ != 0; ++i) pause();
        std::unique_lock lock(mutex_);
        done_.wait(lock, [this] { return active_ == 0; });
    }

    static void pause() {
#if defined(__x86_64__) && defined(__GNUC__)
        __builtin_ia32_pause();
#else
        std::atomic_signal_fence(std::memory_order_seq_cst);
#endif
    }

    static constexpr int SPINS = 2000;  // about 30 us

    // Run tasks until none are left or one has failed. Exceptions must not leave a thread of the pool, nor leave the
    // calling thread before the helpers have finished, because they use its stack.
    void work() noexcept {
        try {
            for (int i; (i = next_.fetch_add(1, std::memory_order_relaxed)) < count_;) task_(context_, i);
        } catch (...) {
            next_.store(count_, std::memory_order_relaxed);  // skip tasks that have not started
            std::lock_guard lock(mutex_);
            if (!error_) error_ = std::current_exception();
        }
    }

    std::atomic<bool> busy_{false};  // set by the caller whose tasks are running
    std::mutex mutex_;               // guards all members below; the atomic ones are read without it
    std::condition_variable wake_, done_;
    int started_ = 0, requested_ = 0;
    std::atomic<int> active_{0};
    Task task_ = nullptr;
    void* context_ = nullptr;
    int count_ = 0;
    std::atomic<int> next_{0};
    std::exception_ptr error_;  // first exception thrown by a task
};

int cores() {
    const unsigned count = std::thread::hardware_concurrency();  // of the machine; the importer may set another number
    return count ? static_cast<int>(count) : 1;
}

std::atomic<int> threads{0};  // 0: one per core

// Never destroyed: its threads sleep until the process ends. A forked child process has none of these threads, so it
// discards the parent's pool, in whatever state, and creates its own.
std::atomic<Pool*> current{nullptr};

Pool& pool() {
#ifndef _WIN32
    static const int registered = pthread_atfork(nullptr, nullptr, [] { current = nullptr; });
    (void)registered;
#endif
    Pool* existing = current.load();
    if (existing) return *existing;
    Pool* fresh = new Pool;
    if (current.compare_exchange_strong(existing, fresh)) return *fresh;
    delete fresh;
    return *existing;
}

}  // namespace

void parallel_for(int count, Task task, void* context) {
    const int max_threads = get_threads();
    const int helpers = (max_threads < count ? max_threads : count) - 1;
    if (helpers < 1) return Pool::run_alone(count, task, context);
    pool().run(count, helpers, task, context);
}

void set_threads(int count) { threads = count; }

int get_threads() {
    const int count = threads;
    return count ? count : cores();
}

}  // namespace omnimirror
