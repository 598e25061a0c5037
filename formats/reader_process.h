// Reading of files in a process of its own.
#pragma once

#include <functional>
#include <string>

namespace haptrace {

/// Calls `read` in a process of its own, with limits on memory and time in proportion to the file, and returns the
/// bytes that it returned. For libraries that end the process, or do not end, at some broken files.
///
/// `what` is what is read, as in "cannot be read as a mesh". Throws Error(input) with the message of what `read`
/// throws, or naming the file if the process ended.
std::string read_in_process(const std::string& file, const std::string& what, const std::function<std::string()>& read);

}  // namespace haptrace
