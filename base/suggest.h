// "did you mean" suggestions for mistyped names.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// Returns the candidate with the smallest edit distance to `word`, or an empty text if none is close to it.
std::string nearest(std::string_view word, std::span<const std::string> candidates);

/// Returns the end of an error message: `; did you mean 'x'?` or, if no candidate is near, `; known: a, b, c`.
std::string suggestion(std::string_view word, std::span<const std::string> candidates);

/// Returns the index of `name` among `names`. Throws Error(input) `unknown KIND 'NAME'` with a suggestion.
std::size_t index_of_name(std::string_view kind, std::string_view name, std::span<const std::string> names);

}  // namespace haptrace
