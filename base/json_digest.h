// A digest within a JSON file, by which a later reader sees that the file was changed or damaged.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace haptrace {

/// Returns `object` with the key `digest` added: the XXH3 (64 bits) of its compact text. It is no protection against
/// forgery.
nlohmann::json with_digest(nlohmann::json object);

/// Returns `document`, the content of the file `where`, without the key `digest`. Throws Error(input), which ends with
/// `remedy`, if the rest is not what with_digest() saw. A document without the key returns as it is.
nlohmann::json without_digest(nlohmann::json document, const std::string& where, const std::string& remedy);

}  // namespace haptrace
