#include "view/loopback_request.h"

#include "base/number.h"

#include <algorithm>
#include <array>

namespace haptrace {

bool is_loopback_host(std::string_view host, std::uint16_t port) noexcept {
  constexpr std::array<std::string_view, 3> kHosts{"127.0.0.1", "[::1]", "localhost"};
  constexpr std::uint16_t kHttpPort = 80;
  for (const std::string_view name : kHosts) {
    if (!host.starts_with(name)) continue;
    const std::string_view rest = host.substr(name.size());
    if (rest.empty()) return port == kHttpPort;
    return rest.front() == ':' && number_of<std::uint16_t>(rest.substr(1)) == port;
  }
  return false;
}

bool is_loopback_origin(std::optional<std::string_view> origin, std::uint16_t port) noexcept {
  constexpr std::string_view kScheme = "http://";
  if (!origin) return true;
  return origin->starts_with(kScheme) && is_loopback_host(origin->substr(kScheme.size()), port);
}

bool accepts_gzip(std::string_view accept_encoding) noexcept {
  while (!accept_encoding.empty()) {
    const std::size_t comma = std::min(accept_encoding.find(','), accept_encoding.size());
    std::string_view entry = accept_encoding.substr(0, comma);
    accept_encoding.remove_prefix(std::min(comma + 1, accept_encoding.size()));
    entry.remove_prefix(std::min(entry.find_first_not_of(" \t"), entry.size()));
    const std::size_t end = std::min(entry.find_first_of("; \t"), entry.size());
    if (entry.substr(0, end) != "gzip") continue;
    const std::size_t quality = entry.find("q=");
    return quality == std::string_view::npos ||
           entry.substr(quality + 2).find_first_of("123456789") != std::string_view::npos;
  }
  return false;
}

}  // namespace haptrace
