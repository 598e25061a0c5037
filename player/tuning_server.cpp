#include "player/tuning_server.h"

#include "control/error.h"

#include <array>
#include <boost/asio.hpp>
#include <charconv>
#include <chrono>
#include <fmt/format.h>
#include <list>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::size_t kLongestLine = 256;  // bytes
constexpr int kMostClients = 16;
constexpr auto kRest = std::chrono::milliseconds(5);           // of a client after each of its commands
constexpr auto kAcceptPause = std::chrono::milliseconds(100);  // after the system could not give a socket

/// One client. It lives as long as something is under way for it.
class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(tcp::socket socket, LiveTuning& tuning, int& clients)
      : socket_(std::move(socket)), rest_(socket_.get_executor()), tuning_(tuning), clients_(clients) {
    ++clients_;
  }
  ~Client() { --clients_; }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void start() {
    if (clients_ > kMostClients)
      answer(fmt::format("error this session has {} clients already; close one of them", kMostClients), true);
    else
      read();
  }

 private:
  void read() {
    socket_.async_read_some(asio::buffer(chunk_), [self = shared_from_this()](error_code error, std::size_t size) {
      if (error) return;
      self->received_.append(self->chunk_.data(), size);
      self->serve();
    });
  }

  /// Answers the next line of what was received, and reads on when there is none. No more than a line and a chunk are
  /// ever kept.
  void serve() {
    for (;;) {
      const std::size_t end = received_.find('\n');
      if (end == std::string::npos) break;
      const std::string line = received_.substr(0, end);
      received_.erase(0, end + 1);
      if (std::exchange(skipping_, false)) continue;
      if (line.find_first_not_of(" \t\r") != std::string::npos) return obey(line);
    }
    if (received_.size() > kLongestLine) {
      received_.clear();
      if (!std::exchange(skipping_, true)) return refuse_length();
    }
    read();
  }

  void obey(const std::string& line) {
    if (line.size() > kLongestLine) return refuse_length();
    // A page in a browser can make it send lines here. What it sends begins with one of these.
    if (line.find(" HTTP/") != std::string::npos) return answer("error this is not a web server", true);
    const std::string reply = tuning_.obey(line);
    answer(reply, reply == "ok bye");
  }

  void refuse_length() {
    answer(fmt::format("error a command has at most {} bytes; help lists them", kLongestLine), false);
  }

  void answer(std::string text, bool last) {
    answer_ = std::move(text) + '\n';
    asio::async_write(socket_, asio::buffer(answer_), [self = shared_from_this(), last](error_code error, std::size_t) {
      if (error || last) return;
      self->rest_.expires_after(kRest);
      self->rest_.async_wait([self](error_code cancelled) {
        if (!cancelled) self->serve();
      });
    });
  }

  tcp::socket socket_;
  asio::steady_timer rest_;
  LiveTuning& tuning_;
  int& clients_;
  std::array<char, 4096> chunk_{};
  std::string received_, answer_;
  bool skipping_ = false;  ///< the rest of a line that was refused
};

}  // namespace

/// The sockets that listen, and the thread that serves.
class TuningServer::Listeners {
 public:
  Listeners(LiveTuning& tuning, std::uint16_t asked) : tuning_(tuning) {
    listen(asio::ip::address_v4::loopback(), asked);
    port = listeners_.front().socket.local_endpoint().port();
    try {
      listen(asio::ip::address_v6::loopback(), port);
    } catch (const Error&) {
      // No IPv6 here, or somebody else's: 127.0.0.1 it is, which is what is told.
    }
    for (Listener& listener : listeners_) accept(listener);
    thread_ = std::jthread([this] { io_.run(); });
  }
  ~Listeners() { io_.stop(); }
  Listeners(const Listeners&) = delete;
  Listeners& operator=(const Listeners&) = delete;

  std::uint16_t port = 0;

 private:
  struct Listener {
    tcp::acceptor socket;
    asio::steady_timer pause;
  };

  void listen(const asio::ip::address& loopback, std::uint16_t asked) {
    const tcp::endpoint endpoint(loopback, asked);
    try {
      listeners_.push_back({tcp::acceptor(io_, endpoint), asio::steady_timer(io_)});
    } catch (const boost::system::system_error& error) {
      throw input_error(fmt::format("cannot listen on port {} of {}: {}; take another, or 0 for any free one", asked,
                                    loopback.to_string(), error.code().message()));
    }
  }

  void accept(Listener& listener) {
    listener.socket.async_accept([this, &listener](error_code error, tcp::socket socket) {
      if (!error) {
        std::make_shared<Client>(std::move(socket), tuning_, clients_)->start();
        return accept(listener);
      }
      // No socket to be had for now: to ask again at once would take a whole processor.
      listener.pause.expires_after(kAcceptPause);
      listener.pause.async_wait([this, &listener](error_code cancelled) {
        if (!cancelled) accept(listener);
      });
    });
  }

  LiveTuning& tuning_;
  int clients_ = 0;  ///< before io_, whose end is theirs
  asio::io_context io_{1};
  std::list<Listener> listeners_;  ///< 127.0.0.1, ::1
  std::jthread thread_;
};

TuningServer::TuningServer(LiveTuning& tuning, std::uint16_t port)
    : listeners_(std::make_unique<Listeners>(tuning, port)) {}

TuningServer::~TuningServer() = default;

std::uint16_t TuningServer::port() const noexcept {
  return listeners_->port;
}

std::uint16_t parse_tuning_port(std::string_view text) {
  std::string_view digits = text;
  for (const std::string_view host : {"127.0.0.1:", "localhost:", "[::1]:"})
    if (text.starts_with(host)) digits = text.substr(host.size());
  std::uint16_t port = 0;
  const char* end = digits.data() + digits.size();
  const auto [rest, error] = std::from_chars(digits.data(), end, port);
  if (error != std::errc{} || rest != end)
    throw input_error(
        fmt::format("tuning port '{}' is not 0 to 65535; the control socket is for this machine alone, so "
                    "that no other address can be given; over a network use ssh -L",
                    text));
  return port;
}

}  // namespace haptrace
