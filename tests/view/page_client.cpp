#include "tests/view/page_client.h"

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <cstring>
#include <deque>
#include <stdexcept>
#include <thread>

namespace haptrace::test {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using boost::system::error_code;

constexpr auto kPatience = std::chrono::minutes(1);

tcp::endpoint loopback(std::uint16_t port) {
  return {asio::ip::address_v4::loopback(), port};
}

template <class Value>
Value value_at(std::string_view bytes, std::size_t offset) {
  if (bytes.size() < offset + sizeof(Value)) throw std::runtime_error("a binary message is too short");
  Value value{};
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

}  // namespace

HttpAnswer http_bytes(std::uint16_t port, const std::string& bytes) {
  asio::io_context io;
  tcp::socket socket(io);
  socket.connect(loopback(port));
  error_code error;
  asio::write(socket, asio::buffer(bytes), error);
  std::string text;
  asio::read(socket, asio::dynamic_buffer(text), error);
  HttpAnswer answer;
  const auto end = text.find("\r\n\r\n");
  if (end == std::string::npos || text.size() < 12) return answer;
  answer.status = static_cast<unsigned>(std::stoul(text.substr(9, 3)));
  answer.head = text.substr(0, end + 2);
  answer.body = text.substr(end + 4);
  return answer;
}

HttpAnswer http_get(std::uint16_t port, const std::string& target, const std::string& headers,
                    const std::string& method) {
  std::string request = method + " " + target + " HTTP/1.1\r\n";
  if (headers.find("Host:") == std::string::npos) request += "Host: 127.0.0.1:" + std::to_string(port) + "\r\n";
  return http_bytes(port, request + headers + "\r\n");
}

BinaryMessage::BinaryMessage(std::string_view message)
    : kind(value_at<std::uint8_t>(message, 0)),
      version(value_at<std::uint8_t>(message, 1)),
      flags(value_at<std::uint16_t>(message, 2)),
      sequence(value_at<std::uint32_t>(message, 4)),
      rows(value_at<std::uint32_t>(message, 8)),
      request(value_at<std::uint32_t>(message, 12)),
      t0(value_at<double>(message, 16)),
      sent(value_at<double>(message, 24)),
      body(message.substr(32)) {}

std::vector<float> BinaryMessage::plane(std::size_t index) const {
  std::vector<float> values(rows);
  for (std::size_t row = 0; row < rows; ++row) values[row] = value_at<float>(body, 4 * (index * rows + row));
  return values;
}

DecodedBins decode_bins(const BinaryMessage& message) {
  DecodedBins bins;
  const auto channels = value_at<std::uint32_t>(message.body, 0), count = value_at<std::uint32_t>(message.body, 4);
  bins.width = value_at<double>(message.body, 8);
  std::size_t offset = 16;
  for (std::uint32_t channel = 0; channel < channels; ++channel) {
    DecodedBins::Channel decoded;
    for (std::vector<float>* values : {&decoded.first, &decoded.min, &decoded.max, &decoded.last})
      for (std::uint32_t k = 0; k < count; ++k, offset += 4) values->push_back(value_at<float>(message.body, offset));
    for (std::uint32_t k = 0; k < count; ++k)
      decoded.min_first.push_back(value_at<std::uint8_t>(message.body, offset + k));
    offset += (count + 3) / 4 * 4;
    bins.channels.push_back(std::move(decoded));
  }
  if (offset != message.body.size()) throw std::runtime_error("bins of a wrong length");
  return bins;
}

class PageClient::Connection {
 public:
  Connection(std::uint16_t port, const std::string& origin, const std::string& host) : stream(io) {
    stream.next_layer().connect(loopback(port));
    stream.next_layer().set_option(tcp::no_delay(true));
    stream.set_option(websocket::stream_base::decorator([origin](websocket::request_type& request) {
      if (!origin.empty()) request.set(boost::beast::http::field::origin, origin);
    }));
    stream.read_message_max(0);
    error_code error;
    stream.handshake(host.empty() ? "127.0.0.1:" + std::to_string(port) : host, "/ws", error);
    if (error) throw std::runtime_error(error.message());
    read();
  }

  void read() {
    stream.async_read(buffer, [this](error_code error, std::size_t) {
      if (error) {
        closed = error == websocket::error::closed ? static_cast<unsigned>(stream.reason().code) : 0;
        return;
      }
      std::string message = boost::beast::buffers_to_string(buffer.data());
      buffer.clear();
      if (stream.got_text())
        texts.push_back(nlohmann::json::parse(message));
      else
        binaries.emplace_back(message);
      read();
    });
  }

  void wait(const std::function<bool()>& done) {
    const auto end = std::chrono::steady_clock::now() + kPatience;
    while (!done()) {
      if (closed) throw std::runtime_error("the server closed the connection: " + std::to_string(*closed));
      io.restart();
      if (io.run_one_until(end) == 0 && !done()) throw std::runtime_error("no message within a minute");
    }
  }

  asio::io_context io;
  websocket::stream<tcp::socket> stream;
  boost::beast::flat_buffer buffer;
  std::deque<nlohmann::json> texts;
  std::deque<BinaryMessage> binaries;
  std::optional<unsigned> closed;
};

PageClient::PageClient(std::uint16_t port, const std::string& origin, const std::string& host)
    : connection_(std::make_unique<Connection>(port, origin, host)) {}

PageClient::~PageClient() = default;

void PageClient::send(const nlohmann::json& message) {
  send_text(message.dump());
}

void PageClient::send_text(const std::string& text) {
  error_code error;  // a closed connection shows when the answer is waited for
  connection_->stream.text(true);
  connection_->stream.write(asio::buffer(text), error);
}

void PageClient::send_binary(const std::string& bytes) {
  error_code error;
  connection_->stream.binary(true);
  connection_->stream.write(asio::buffer(bytes), error);
}

void PageClient::hello(const std::string& token, std::optional<double> last) {
  nlohmann::json message{{"type", "hello"}, {"version", 1}, {"token", token}};
  if (last) message["last"] = *last;
  send(message);
}

void PageClient::intend(double x, double y, double z, double grip) {
  std::string message(32 + 24, '\0');
  message[0] = 8;
  message[1] = 1;
  message[8] = 1;
  std::size_t offset = 32;
  for (const double value : {x, y, z, grip}) {
    const auto single = static_cast<float>(value);
    std::memcpy(message.data() + offset, &single, sizeof single);
    offset += sizeof single;
  }
  message[offset] = 1;      // mouse
  message[offset + 4] = 1;  // depth from the path
  send_binary(message);
}

nlohmann::json PageClient::wait_for(const std::string& type) {
  return wait_for(type, [](const nlohmann::json&) { return true; });
}

nlohmann::json PageClient::wait_for(const std::string& type,
                                    const std::function<bool(const nlohmann::json&)>& matches) {
  std::size_t seen = 0;
  std::optional<nlohmann::json> found;
  connection_->wait([&] {
    auto& texts = connection_->texts;
    for (; seen < texts.size(); ++seen) {
      if (texts[seen].at("type") != type || !matches(texts[seen])) continue;
      found = texts[seen];
      texts.erase(texts.begin() + static_cast<std::ptrdiff_t>(seen));
      return true;
    }
    return false;
  });
  return *found;
}

BinaryMessage PageClient::wait_for_binary(const std::function<bool(const BinaryMessage&)>& matches) {
  std::optional<BinaryMessage> found;
  connection_->wait([&] {
    auto& binaries = connection_->binaries;
    while (!binaries.empty() && !found) {
      if (matches(binaries.front())) found = std::move(binaries.front());
      binaries.pop_front();
    }
    return found.has_value();
  });
  return *found;
}

BinaryMessage PageClient::wait_for_binary(std::uint8_t kind) {
  return wait_for_binary([kind](const BinaryMessage& message) { return message.kind == kind; });
}

BinaryMessage PageClient::wait_for_answer(std::uint32_t request) {
  return wait_for_binary(
      [request](const BinaryMessage& message) { return message.request == request && message.kind != 4; });
}

unsigned PageClient::wait_for_close() {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!connection_->closed) {
    connection_->io.restart();
    if (connection_->io.run_one_until(end) == 0) throw std::runtime_error("the server does not close the connection");
  }
  return *connection_->closed;
}

void PageClient::disconnect() {
  error_code ignored;
  connection_->stream.next_layer().close(ignored);
}

std::string token_of(const std::string& address) {
  return address.substr(address.find('#') + 1);
}

std::uint16_t port_of(const std::string& address) {
  return static_cast<std::uint16_t>(std::stoul(address.substr(address.rfind(':') + 1)));
}

}  // namespace haptrace::test
