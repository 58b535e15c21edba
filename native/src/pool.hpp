// Threads that sleep until there is work.
#pragma once

namespace omnimirror {

using Task = void (*)(void* context, int index);

// Call task(context, i) for i in [0, count) on the threads of the pool and this one; return when all are done.
//
// A task may throw: tasks that have not begun are then left out, those that have are waited for, and the first exception
// is thrown here. While the pool works for another caller, or where a task calls this again, the calling thread does all
// of its work alone.
void parallel_for(int count, Task task, void* context);

// The number of threads that work, the calling one included.
void set_threads(int count);
int get_threads();

}  // namespace omnimirror
