#include "base/suggest.h"

#include "base/error.h"

#include <algorithm>
#include <fmt/format.h>
#include <numeric>

namespace haptrace {
namespace {

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// Returns the number of insertions, deletions, substitutions and swaps of neighbours that turn `a` into `b`, ignoring
/// case (the optimal string alignment distance: Damerau 1964, Oommen and Loke 1997).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), above(b.size() + 1), row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::swap(before, above);
    std::swap(above, row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const char p = lower(a[i - 1]), q = lower(b[j - 1]);
      row[j] = std::min({above[j] + 1, row[j - 1] + 1, above[j - 1] + (p == q ? 0U : 1U)});
      if (i > 1 && j > 1 && p == lower(b[j - 2]) && q == lower(a[i - 2])) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

}  // namespace

std::string nearest(std::string_view word, std::span<const std::string> candidates) {
  const std::string* best = nullptr;
  std::size_t best_distance = 0;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    // Allow one slip per three letters. A word that shares no letter is never near.
    const std::size_t slips = std::max<std::size_t>(1, std::max(word.size(), candidate.size()) / 3);
    if (distance > slips || distance >= std::max(word.size(), candidate.size())) continue;
    if (best == nullptr || distance < best_distance) best = &candidate, best_distance = distance;
  }
  return best != nullptr ? *best : std::string{};
}

std::string suggestion(std::string_view word, std::span<const std::string> candidates) {
  const std::string near = nearest(word, candidates);
  if (!near.empty()) return fmt::format("; did you mean '{}'?", near);
  if (candidates.empty()) return {};
  return fmt::format("; known: {}", fmt::join(candidates, ", "));
}

std::size_t index_of_name(std::string_view kind, std::string_view name, std::span<const std::string> names) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) throw input_error(fmt::format("unknown {} '{}'{}", kind, name, suggestion(name, names)));
  return static_cast<std::size_t>(found - names.begin());
}

}  // namespace haptrace
