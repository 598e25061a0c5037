#include "base/json_digest.h"

#include "base/error.h"

#include <fmt/format.h>
#include <utility>
#include <xxhash.h>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr const char* kDigest = "digest";

std::string digest_of(const json& object) {
  const std::string text = object.dump(-1, ' ', false, json::error_handler_t::replace);
  return fmt::format("xxh3:{:016x}", XXH3_64bits(text.data(), text.size()));
}

}  // namespace

json with_digest(json object) {
  std::string digest = digest_of(object);
  object[kDigest] = std::move(digest);
  return object;
}

json without_digest(json document, const std::string& where, const std::string& remedy) {
  if (!document.is_object() || !document.contains(kDigest)) return document;
  const json digest = std::move(document[kDigest]);
  document.erase(kDigest);
  if (digest != digest_of(document))
    throw input_error(fmt::format("{}: its content is no longer what was written; {}", where, remedy));
  return document;
}

}  // namespace haptrace
