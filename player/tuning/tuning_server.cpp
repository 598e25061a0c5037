#include "player/tuning/tuning_server.h"

#include "base/error.h"
#include "base/number.h"
#include "base/secret.h"
#include "player/tuning/private_socket.h"

#include <algorithm>
#include <array>
#include <boost/asio.hpp>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fmt/format.h>
#include <list>
#include <random>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace haptrace {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using asio::local::stream_protocol;
using boost::system::error_code;
/// Stream of a TCP or a Unix socket.
using Stream = asio::generic::stream_protocol;

constexpr std::size_t kLongestLine = 256;  // bytes
constexpr std::size_t kMostOperators = 16, kMostStrangers = 64;
constexpr std::size_t kShortestToken = 16, kLongestToken = 128;  // bytes
constexpr std::string_view kTokenWord = "token ";
constexpr int kMostDrained = 64;                               // largest number of chunks drained from a closing client
constexpr auto kRest = std::chrono::milliseconds(5);           // pause of a client after each command
constexpr auto kAcceptPause = std::chrono::milliseconds(100);  // pause after a failed accept

bool is_printable(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c >= ' ' && c <= '~') || c == '\t' || c == '\r'; });
}

class Client;

/// Connected clients, ordered by silence, longest first.
struct Clients {
  std::list<Client*> operators, strangers;
};

/// One client. It lives as long as one of its operations is pending.
class Client : public std::enable_shared_from_this<Client> {
 public:
  /// `token`: token that makes a stranger an operator; empty: the client is an operator.
  Client(Stream::socket socket, Commands& commands, Clients& clients, std::string_view token)
      : socket_(std::move(socket)),
        timer_(socket_.get_executor()),
        commands_(commands),
        clients_(clients),
        token_(token) {
    list().push_back(this);
  }
  ~Client() { list().remove(this); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void start(std::chrono::milliseconds patience) {
    make_room();
    if (is_stranger()) {
      timer_.expires_after(patience);
      timer_.async_wait([self = shared_from_this()](error_code cancelled) {
        if (!cancelled && self->is_stranger()) self->close();
      });
    }
    read();
  }

 private:
  [[nodiscard]] bool is_stranger() const { return !token_.empty(); }
  [[nodiscard]] std::list<Client*>& list() { return is_stranger() ? clients_.strangers : clients_.operators; }

  /// Closes the client that was silent longest, unless there is room. A new client always gets a place, so that neither
  /// strangers nor forgotten connections keep an operator out.
  void make_room() {
    const std::size_t most = is_stranger() ? kMostStrangers : kMostOperators;
    if (list().size() > most) list().front()->close();
  }

  /// Cancels all pending operations, which ends the client's life.
  void close() {
    list().remove(this);
    error_code ignored;
    socket_.close(ignored);
    timer_.cancel();
  }

  void read() {
    socket_.async_read_some(asio::buffer(chunk_), [self = shared_from_this()](error_code error, std::size_t size) {
      if (error || !self->socket_.is_open()) return self->close();
      self->received_.append(self->chunk_.data(), size);
      if (self->is_stranger())
        self->admit();
      else
        self->serve();
    });
  }

  /// Checks the first bytes of a stranger.
  void admit() {
    const std::size_t end = received_.find('\n');
    const std::string_view line = std::string_view(received_).substr(0, end);
    const std::size_t compared = std::min(line.size(), kTokenWord.size());
    if (line.substr(0, compared) != kTokenWord.substr(0, compared) ||
        line.size() > kTokenWord.size() + kLongestToken + 1)
      return close();
    if (end == std::string::npos) return read();
    if (!line.starts_with(kTokenWord)) return close();
    std::string_view given = line.substr(kTokenWord.size());
    if (given.ends_with('\r')) given.remove_suffix(1);
    // No browser starts a request with this word, so a client that did may learn what was wrong.
    if (!is_same_secret(given, token_)) return answer("error this is not the token of this session", true);
    received_.erase(0, end + 1);
    list().remove(this);
    token_ = {};
    list().push_back(this);
    make_room();
    timer_.cancel();
    serve();
  }

  /// Answers the next received line, or reads on if there is none. The buffer holds at most a line and a chunk.
  void serve() {
    for (;;) {
      const std::size_t end = received_.find('\n');
      if (std::min(end, received_.size()) > kLongestLine)
        return answer(fmt::format("error a command has at most {} bytes", kLongestLine), true);
      if (end == std::string::npos) return read();
      const std::string line = received_.substr(0, end);
      received_.erase(0, end + 1);
      if (line.find_first_not_of(" \t\r") != std::string::npos) return obey(line);
    }
  }

  void obey(const std::string& line) {
    if (line.find(" HTTP/") != std::string::npos) return answer("error this is not a web server", true);
    if (!is_printable(line)) return answer("error a command is a line of printable ASCII", true);
    list().remove(this);
    list().push_back(this);
    const std::string reply = commands_.obey(line);
    answer(reply, reply == "ok bye");
  }

  void answer(std::string text, bool last) {
    answer_ = std::move(text) + '\n';
    asio::async_write(socket_, asio::buffer(answer_), [self = shared_from_this(), last](error_code error, std::size_t) {
      if (error || last) return self->finish();
      self->timer_.expires_after(kRest);
      self->timer_.async_wait([self](error_code cancelled) {
        if (!cancelled && self->socket_.is_open()) self->serve();
      });
    });
  }

  /// Ends the connection without a reset. A reset would discard the last answer to a client that still sends.
  void finish() {
    error_code ignored;
    socket_.shutdown(Stream::socket::shutdown_send, ignored);
    for (int reads = 0; reads < kMostDrained && socket_.available(ignored) > 0; ++reads)
      socket_.read_some(asio::buffer(chunk_), ignored);
    close();
  }

  Stream::socket socket_;
  asio::steady_timer timer_;  ///< pause after a command, or time limit of a stranger
  Commands& commands_;
  Clients& clients_;
  std::string_view token_;
  std::array<char, 4096> chunk_{};
  std::string received_, answer_;
};

}  // namespace

/// Listening sockets and the thread that serves their clients.
class TuningServer::Listeners {
 public:
  Listeners(Commands& commands, Options options) : commands_(commands), options_(std::move(options)) {
    if (options_.port) {
      if (options_.token.size() < kShortestToken || options_.token.size() > kLongestToken)
        throw input_error(fmt::format("the token of a tuning port must have {} to {} characters; this one has {}",
                                      kShortestToken, kLongestToken, options_.token.size()));
      listen(asio::ip::address_v4::loopback(), *options_.port);
      port = port_of(listeners_.front().socket);
      try {
        listen(asio::ip::address_v6::loopback(), port);
      } catch (const Error&) {
        // There is no IPv6, or another program has the port. 127.0.0.1 is the reported address.
      }
    }
    if (!options_.socket.empty()) {
      unix_.emplace(options_.socket);
      listeners_.push_back(
          {stream_protocol::acceptor(io_, stream_protocol(), unix_->release()), asio::steady_timer(io_), false});
    }
    for (Listener& listener : listeners_) accept(listener);
    thread_ = std::jthread([this] { io_.run(); });
  }
  ~Listeners() { io_.stop(); }
  Listeners(const Listeners&) = delete;
  Listeners& operator=(const Listeners&) = delete;

  std::uint16_t port = 0;

 private:
  using Acceptor = asio::basic_socket_acceptor<Stream>;
  struct Listener {
    Acceptor socket;
    asio::steady_timer pause;
    bool strangers;  ///< its clients need the token
  };

  static std::uint16_t port_of(const Acceptor& socket) {
    const Stream::endpoint endpoint = socket.local_endpoint();
    sockaddr_in address{};
    std::memcpy(&address, endpoint.data(), sizeof address);
    return ntohs(address.sin_port);
  }

  void listen(const asio::ip::address& loopback, std::uint16_t asked) {
    const tcp::endpoint endpoint(loopback, asked);
    try {
      listeners_.push_back({tcp::acceptor(io_, endpoint), asio::steady_timer(io_), true});
    } catch (const boost::system::system_error& error) {
      throw input_error(fmt::format("cannot listen on port {} of {}: {}; choose another port, or 0 for any free port",
                                    asked, loopback.to_string(), error.code().message()));
    }
  }

  void accept(Listener& listener) {
    listener.socket.async_accept([this, &listener](error_code error, Stream::socket socket) {
      if (!error) {
        if (listener.strangers || is_peer_trusted(socket.native_handle()))
          std::make_shared<Client>(std::move(socket), commands_, clients_,
                                   listener.strangers ? std::string_view(options_.token) : std::string_view{})
              ->start(options_.patience);
        return accept(listener);
      }
      // No socket is available now. An immediate retry would occupy a whole processor.
      listener.pause.expires_after(kAcceptPause);
      listener.pause.async_wait([this, &listener](error_code cancelled) {
        if (!cancelled) accept(listener);
      });
    });
  }

  Commands& commands_;
  const Options options_;
  std::optional<PrivateSocket> unix_;
  Clients clients_;  ///< declared before io_, whose destructor ends the clients
  asio::io_context io_{1};
  std::list<Listener> listeners_;  ///< 127.0.0.1, ::1, the Unix socket
  std::jthread thread_;
};

TuningServer::TuningServer(Commands& commands, Options options)
    : listeners_(std::make_unique<Listeners>(commands, std::move(options))) {}

TuningServer::~TuningServer() = default;

std::uint16_t TuningServer::port() const noexcept {
  return listeners_->port;
}

std::string new_tuning_token() {
  std::random_device random;  // the system's generator, which is suitable for secrets
  std::string token;
  for (int word = 0; word < 4; ++word) token += fmt::format("{:08x}", random());
  return token;
}

std::string read_tuning_token(const std::string& file) {
  const auto refuse = [&](const std::string& why) { return input_error(fmt::format("{}: {}", file, why)); };
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
  if (descriptor < 0) throw refuse(fmt::format("cannot be read: {}", std::strerror(errno)));
  struct stat status {};
  const bool known = fstat(descriptor, &status) == 0;
  std::array<char, kTokenWord.size() + kLongestToken + 3> text{};
  const ssize_t size = known && S_ISREG(status.st_mode) ? read(descriptor, text.data(), text.size()) : -1;
  close(descriptor);
  if (size < 0) throw refuse("is not a readable regular file");
  if (status.st_uid != geteuid() || (status.st_mode & 0077U) != 0)
    throw refuse("other users can read or change this token; make the file private: chmod 600");
  std::string_view token(text.data(), static_cast<std::size_t>(size));
  token = token.substr(0, token.find_first_of("\r\n"));
  if (token.starts_with(kTokenWord)) token.remove_prefix(kTokenWord.size());
  if (token.size() < kShortestToken || token.size() > kLongestToken || !is_printable(token) ||
      token.find_first_of(" \t") != std::string_view::npos)
    throw refuse(fmt::format("contains no token of {} to {} letters and digits; remove the file to get a new token",
                             kShortestToken, kLongestToken));
  return std::string(token);
}

void write_tuning_token(const std::string& token, const std::string& file) {
  const std::string line = fmt::format("{}{}\n", kTokenWord, token);
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  const bool written =
      descriptor >= 0 && write(descriptor, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  const int reason = errno;
  if (descriptor >= 0) close(descriptor);
  if (!written) throw input_error(fmt::format("{}: the token cannot be written: {}", file, std::strerror(reason)));
}

std::uint16_t parse_tuning_port(std::string_view text) {
  std::string_view digits = text;
  for (const std::string_view host : {"127.0.0.1:", "localhost:", "[::1]:"})
    if (text.starts_with(host)) digits = text.substr(host.size());
  const auto port = number_of<std::uint16_t>(digits);
  if (!port)
    throw input_error(
        fmt::format("tuning port '{}' is not a number from 0 to 65535; the port is open to this machine alone, so give "
                    "no other address; over a network use ssh -L",
                    text));
  return *port;
}

}  // namespace haptrace
