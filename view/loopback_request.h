// Checks of the headers of a request. Private to view.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace haptrace {

/// Returns true if `host` is literally 127.0.0.1:PORT, [::1]:PORT or localhost:PORT. A name of somebody else that leads
/// to this machine is none of these.
bool is_loopback_host(std::string_view host, std::uint16_t port) noexcept;

/// Returns true if there is no origin, as from a program, or it is http:// and a loopback host.
bool is_loopback_origin(std::optional<std::string_view> origin, std::uint16_t port) noexcept;

/// Returns true if the value of an Accept-Encoding header allows gzip.
bool accepts_gzip(std::string_view accept_encoding) noexcept;

}  // namespace haptrace
