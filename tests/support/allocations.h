// Counts heap operations, to show that a real-time function neither allocates nor frees memory.
#pragma once

#include <cstddef>

namespace haptrace::test {

/// Returns how often this thread called operator new, or operator delete with memory, since the program started.
std::size_t allocations() noexcept;

}  // namespace haptrace::test
