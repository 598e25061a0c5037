// "did you mean": every list of names that a person can mistype answers with the nearest.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The candidate with the smallest edit distance to `word`, if it is close enough to be a slip; else empty.
std::string nearest(std::string_view word, std::span<const std::string> candidates);

/// `; did you mean 'x'?` or, with nothing near, `; known: a, b, c`. For the end of an error message.
std::string suggestion(std::string_view word, std::span<const std::string> candidates);

/// Returns the index of `name` among `names`. Throws Error(input) `unknown KIND 'NAME'` with a suggestion.
std::size_t index_of_name(std::string_view kind, std::string_view name, std::span<const std::string> names);

}  // namespace haptrace
