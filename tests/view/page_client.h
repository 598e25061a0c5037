// A page for tests: a WebSocket client that waits for messages.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::test {

/// An answer to one HTTP request.
struct HttpAnswer {
  unsigned status = 0;  ///< 0: the connection was closed without an answer
  std::string head, body;
};

/// Sends bytes to a port of 127.0.0.1 and reads until the server closes.
HttpAnswer http_bytes(std::uint16_t port, const std::string& bytes);

/// Sends a request for `target` with the Host 127.0.0.1:port, unless `headers` name another.
HttpAnswer http_get(std::uint16_t port, const std::string& target, const std::string& headers = "",
                    const std::string& method = "GET");

/// A binary message of the server.
struct BinaryMessage {
  std::uint8_t kind = 0, version = 0;
  std::uint16_t flags = 0;
  std::uint32_t sequence = 0, rows = 0, request = 0;
  double t0 = 0, sent = 0;
  std::string body;

  explicit BinaryMessage(std::string_view message);

  /// Returns plane `index` of `rows` values.
  [[nodiscard]] std::vector<float> plane(std::size_t index) const;
};

/// Bins of a message of kind 3.
struct DecodedBins {
  double width = 0;
  struct Channel {
    std::vector<float> first, min, max, last;
    std::vector<std::uint8_t> min_first;
  };
  std::vector<Channel> channels;
};
DecodedBins decode_bins(const BinaryMessage& message);

/// A WebSocket connection to /ws. All waits end with an exception after a minute, which no healthy server needs.
class PageClient {
 public:
  /// Connects and upgrades. Throws std::runtime_error if the server refuses. `headers`: "Origin: ..." and so on.
  explicit PageClient(std::uint16_t port, const std::string& origin = "", const std::string& host = "");
  ~PageClient();
  PageClient(const PageClient&) = delete;
  PageClient& operator=(const PageClient&) = delete;

  void send(const nlohmann::json& message);
  void send_text(const std::string& text);
  void send_binary(const std::string& bytes);
  void hello(const std::string& token, std::optional<double> last = std::nullopt);
  void intend(double x, double y, double z, double grip);

  /// Waits for the next message of a type; keeps others for later calls.
  nlohmann::json wait_for(const std::string& type);
  nlohmann::json wait_for(const std::string& type, const std::function<bool(const nlohmann::json&)>& matches);

  /// Waits for the next binary message that `matches`; discards others.
  BinaryMessage wait_for_binary(const std::function<bool(const BinaryMessage&)>& matches);
  BinaryMessage wait_for_binary(std::uint8_t kind);
  BinaryMessage wait_for_answer(std::uint32_t request);  ///< not a path, which has ids of its own

  /// Waits until the server closes the connection. Returns the code, or 0 without a close message.
  unsigned wait_for_close();

  /// Stops or resumes reading, as a page whose browser hangs.
  void disconnect();

 private:
  class Connection;
  std::unique_ptr<Connection> connection_;
};

/// Returns the token and the port in an address.
std::string token_of(const std::string& address);
std::uint16_t port_of(const std::string& address);

}  // namespace haptrace::test
