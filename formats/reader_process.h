// Reading of files in a process of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace haptrace {

/// Limits of a process that reads a file. A broken file may state any size, so they grow with the file.
struct ReaderLimits {
  std::uint64_t memory = 0;            ///< [bytes]
  std::uint64_t memory_per_byte = 0;   ///< further memory for each byte of the file [bytes]
  std::uint64_t seconds = 0;           ///< of CPU time
  std::uint64_t bytes_per_second = 1;  ///< each so many bytes of the file add a second
};

/// Calls `read` in a process of its own within `limits`, and returns the bytes that it returned. For libraries that end
/// the process, or do not end, at some broken files.
///
/// `what` completes the sentence "cannot be read as". Throws Error(input) with the message of what `read` throws, or
/// naming the file if the process ended.
std::string read_in_process(const std::string& file, const std::string& what, const ReaderLimits& limits,
                            const std::function<std::string()>& read);

}  // namespace haptrace
