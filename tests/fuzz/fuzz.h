// Common parts of the fuzz targets. A target calls one entry point for files and texts of unknown origin, which may
// reject them only with an Error.
#pragma once

#include "base/error.h"
#include "tests/support/temp_folder.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace haptrace::fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// Runs `action`; an Error is a valid result.
template <class Action>
void answer(const Action& action) {
  try {
    action();
  } catch (const Error&) {
  }
}

/// Ends the program, which the fuzzer reports, if the entry point breaks a promise.
inline void require(bool promise) {
  if (!promise) __builtin_trap();
}

/// Writes a file of this content and returns its name; the next call replaces the file.
inline std::string file_of(std::string_view content) {
  static const test::TempFolder folder;
  return folder.write("input", content);
}

}  // namespace haptrace::fuzz
