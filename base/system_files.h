// Reading what the kernel says in files, which may not be there: /sys, /proc, configurations.
#pragma once

#include <charconv>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace haptrace::system_files {

/// A small file, plain or compressed by gzip, without the white space at its end. Nothing when it cannot be read.
std::optional<std::string> read_text(const std::filesystem::path& file);

/// What a folder holds, by name; nothing when it cannot be read.
std::vector<std::filesystem::path> entries(const std::filesystem::path& folder);

/// The number that `text` is, and nothing but.
template <class Number>
std::optional<Number> number_of(std::string_view text, int base = 10) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  if (error != std::errc() || end != text.data() + text.size()) return {};
  return value;
}

}  // namespace haptrace::system_files
