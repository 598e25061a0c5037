// Comparison of secrets.
#pragma once

#include <cstddef>
#include <string_view>

namespace haptrace {

/// Compares in constant time, which does not reveal how much of the secret was right.
inline bool is_same_secret(std::string_view given, std::string_view secret) noexcept {
  if (given.size() != secret.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < secret.size(); ++i)
    difference |= static_cast<unsigned>(static_cast<unsigned char>(given[i]) ^ static_cast<unsigned char>(secret[i]));
  return difference == 0;
}

}  // namespace haptrace
