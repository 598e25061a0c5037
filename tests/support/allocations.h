// Counts uses of the heap: the proof that a real-time function allocates nothing, and frees nothing.
#pragma once

#include <cstddef>

namespace haptrace::test {

/// Returns how often this thread called operator new, or operator delete with memory, since the program started.
std::size_t allocations() noexcept;

}  // namespace haptrace::test
