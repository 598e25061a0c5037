// What the fuzz targets share. A target is one entry point for files and texts of unknown origin: it may refuse them
// with an Error, and nothing else.
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

/// Runs `action`; to refuse the input is an answer.
template <class Action>
void answer(const Action& action) {
  try {
    action();
  } catch (const Error&) {
  }
}

/// Ends the program, which is a finding, when a promise of the entry point is broken.
inline void require(bool promise) {
  if (!promise) __builtin_trap();
}

/// The name of a file of this content, which the next call replaces.
inline std::string file_of(std::string_view content) {
  static const test::TempFolder folder;
  return folder.write("input", content);
}

}  // namespace haptrace::fuzz
