#include "view/view_server.h"

#include "base/error.h"
#include "base/secret.h"
#include "view/gzip.h"
#include "view/loopback_request.h"
#include "view/page_connection.h"

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <fmt/format.h>
#include <future>
#include <list>
#include <optional>
#include <thread>

namespace haptrace {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::size_t kLongestHead = 8192;                     // of a request [bytes]
constexpr std::size_t kMostVisitors = 64;                      // connections that have not shown a token
constexpr auto kAcceptPause = std::chrono::milliseconds(100);  // pause after a failed accept
constexpr auto kGoodbye = std::chrono::milliseconds(300);      // time for the pages to take the last messages

std::string_view text_of(boost::beast::string_view text) {
  return {text.data(), text.size()};
}

using Response = http::response<http::string_body>;

/// Adds what keeps other sites in the same browser away from the page.
void protect(Response& response) {
  response.set("Content-Security-Policy",
               "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
  response.set("X-Content-Type-Options", "nosniff");
  response.set("X-Frame-Options", "DENY");
  response.set(http::field::cache_control, "no-store");
  response.set("Referrer-Policy", "no-referrer");
  response.set("Cross-Origin-Resource-Policy", "same-origin");
  response.set("Cross-Origin-Opener-Policy", "same-origin");
}

}  // namespace

/// Listening sockets, connections and the thread that serves them once it has started.
class ViewServer::Listeners final : public PageRegistry {
 public:
  Listeners(Options options, PageHandler& handler) : options_(std::move(options)), handler_(handler) {
    listen_on_both();
    for (Acceptor& acceptor : acceptors_) accept(acceptor);
  }

  ~Listeners() override {
    if (thread_.joinable()) {
      asio::post(io_, [this] { close(); });
      thread_.join();
    }
    pages_.clear();  // while io_ lives: a page that took no goodbye still has its socket
  }
  Listeners(const Listeners&) = delete;
  Listeners& operator=(const Listeners&) = delete;

  void start() {
    thread_ = std::jthread([this] { io_.run(); });
  }

  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }
  [[nodiscard]] const Options& options() const noexcept { return options_; }
  [[nodiscard]] const std::vector<std::shared_ptr<ViewPage>>& pages() const noexcept { return pages_; }
  asio::io_context& io() noexcept { return io_; }

  void every(std::chrono::milliseconds period, std::function<void()> task) {
    asio::post(io_, [this, period, task = std::move(task)]() mutable {
      repeats_.push_back({asio::steady_timer(io_), period, std::move(task)});
      repeats_.back().timer.expires_after(period);
      wait(repeats_.back());
    });
  }

 private:
  struct Acceptor {
    tcp::acceptor socket;
    asio::steady_timer pause;
  };
  struct Repeat {
    asio::steady_timer timer;
    std::chrono::milliseconds period;
    std::function<void()> task;
  };

  /// One HTTP request.
  struct Visitor : std::enable_shared_from_this<Visitor> {
    Visitor(tcp::socket stream, Listeners& listeners)
        : socket(std::move(stream)), timer(listeners.io_), owner(listeners) {
      parser.header_limit(kLongestHead);
      parser.body_limit(std::uint64_t{0});
      owner.visitors_.push_back(this);
    }
    ~Visitor() { owner.visitors_.remove(this); }
    Visitor(const Visitor&) = delete;
    Visitor& operator=(const Visitor&) = delete;

    void start() {
      timer.expires_after(owner.options_.patience);
      timer.async_wait([self = shared_from_this()](error_code cancelled) {
        if (!cancelled) self->close();
      });
      http::async_read(socket, buffer, parser, [self = shared_from_this()](error_code error, std::size_t) {
        if (error) return self->close();
        self->owner.answer(*self);
      });
    }

    void send(Response answered) {
      response = std::move(answered);
      response.keep_alive(false);
      response.prepare_payload();
      http::async_write(socket, response, [self = shared_from_this()](error_code, std::size_t) {
        error_code ignored;
        self->socket.shutdown(tcp::socket::shutdown_send, ignored);
        self->close();
      });
    }

    void send_head(http::response<http::empty_body> answered) {
      head = std::move(answered);
      http::async_write(socket, head, [self = shared_from_this()](error_code, std::size_t) { self->close(); });
    }

    void close() {
      error_code ignored;
      socket.close(ignored);
      timer.cancel();
    }

    tcp::socket socket;
    asio::steady_timer timer;
    Listeners& owner;
    boost::beast::flat_buffer buffer{kLongestHead};
    http::request_parser<http::empty_body> parser;
    Response response;
    http::response<http::empty_body> head;
  };

  /// Listens on the port of both loopback addresses. A browser may take "localhost" for either, so no other program
  /// may have the port on ::1. A machine without IPv6 has no such address.
  void listen_on_both() {
    constexpr int kAttempts = 16;
    for (int attempt = 1;; ++attempt) {
      listen(asio::ip::address_v4::loopback(), options_.port);
      port_ = acceptors_.front().socket.local_endpoint().port();
      try {
        listen(asio::ip::address_v6::loopback(), port_);
        return;
      } catch (const Taken&) {
        if (options_.port != 0 || attempt == kAttempts) throw;
        acceptors_.clear();
      } catch (const Error&) {
        return;
      }
    }
  }

  /// The port belongs to another program.
  struct Taken : Error {
    using Error::Error;
  };

  void listen(const asio::ip::address& loopback, std::uint16_t asked) {
    try {
      acceptors_.push_back({tcp::acceptor(io_, tcp::endpoint(loopback, asked)), asio::steady_timer(io_)});
    } catch (const boost::system::system_error& error) {
      if (error.code() == asio::error::address_in_use)
        throw Taken(Error::Kind::input,
                    fmt::format("another program listens on port {} of {}; choose another port, or 0 for any free port",
                                asked, loopback.to_string()));
      throw input_error(fmt::format("cannot listen on port {} of {}: {}; choose another port, or 0 for any free port",
                                    asked, loopback.to_string(), error.code().message()));
    }
  }

  void accept(Acceptor& acceptor) {
    acceptor.socket.async_accept([this, &acceptor](error_code error, tcp::socket socket) {
      if (closing_) return;
      if (!error) {
        make_room();
        std::make_shared<Visitor>(std::move(socket), *this)->start();
        return accept(acceptor);
      }
      // No socket is available now. An immediate retry would occupy a whole processor.
      acceptor.pause.expires_after(kAcceptPause);
      acceptor.pause.async_wait([this, &acceptor](error_code cancelled) {
        if (!cancelled && !closing_) accept(acceptor);
      });
    });
  }

  /// Closes the oldest connection without a token, unless there is room. A new connection always gets a place, so that
  /// forgotten ones and strangers keep nobody out.
  void make_room() {
    if (visitors_.size() >= kMostVisitors) {
      Visitor* oldest = visitors_.front();
      visitors_.pop_front();
      oldest->close();
    }
    std::erase_if(strangers_, [](const auto& stranger) { return stranger.expired(); });
    if (strangers_.size() >= kMostVisitors) {
      const auto oldest = strangers_.front().lock();
      strangers_.pop_front();
      if (oldest) oldest->abort();
    }
  }

  void answer(Visitor& visitor) {
    const auto& request = visitor.parser.get();
    const auto refuse = [&](http::status status, const char* why) {
      Response response(status, request.version());
      protect(response);
      response.set(http::field::content_type, "text/plain; charset=utf-8");
      response.body() = std::string(why) + "\n";
      visitor.send(std::move(response));
    };
    const auto origin = request.find(http::field::origin);
    const auto hosts = request.equal_range(http::field::host);
    if (std::distance(hosts.first, hosts.second) != 1 || !is_loopback_host(text_of(hosts.first->value()), port_))
      return refuse(http::status::forbidden, "this address is only for programs on this machine: use 127.0.0.1");
    if (request.count(http::field::origin) > 1 ||
        !is_loopback_origin(origin == request.end() ? std::nullopt : std::optional(text_of(origin->value())), port_))
      return refuse(http::status::forbidden, "another site may not use this address");
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return refuse(http::status::method_not_allowed, "only GET and HEAD are allowed");
    const std::string_view target = text_of(request.target());
    if (target == "/ws") {
      if (request.method() != http::verb::get || !boost::beast::websocket::is_upgrade(request))
        return refuse(http::status::bad_request, "this is the address of a WebSocket");
      const auto page = std::make_shared<PageConnection>(std::move(visitor.socket), handler_, *this);
      strangers_.push_back(page);
      page->start(request, options_.patience);
      visitor.timer.cancel();
      return;
    }
    const auto asset = std::find_if(options_.assets.begin(), options_.assets.end(),
                                    [&](const PageAsset& known) { return known.path == target; });
    if (asset == options_.assets.end()) return refuse(http::status::not_found, "there is nothing at this address");
    serve(*asset, visitor);
  }

  static void serve(const PageAsset& asset, Visitor& visitor) {
    const auto& request = visitor.parser.get();
    const bool compressed = asset.compressed && accepts_gzip(text_of(request[http::field::accept_encoding]));
    Response response(http::status::ok, request.version());
    protect(response);
    response.set(http::field::content_type, boost::beast::string_view(asset.type.data(), asset.type.size()));
    response.set(http::field::vary, "Accept-Encoding");
    if (compressed) response.set(http::field::content_encoding, "gzip");
    response.body() = asset.compressed && !compressed ? gunzip(asset.content) : std::string(asset.content);
    if (request.method() == http::verb::get) return visitor.send(std::move(response));
    response.prepare_payload();
    response.keep_alive(false);
    visitor.send_head(http::response<http::empty_body>(std::move(response.base())));
  }

  [[nodiscard]] std::optional<ViewRole> role_of(const std::string& token) const override {
    std::optional<ViewRole> found;
    for (const auto& [role, secret] : options_.tokens)
      if (is_same_secret(token, secret)) found = role;
    return found;
  }

  void admit(const std::shared_ptr<PageConnection>& page) override {
    if (pages_.size() >= options_.most_pages) {
      // The page that was silent longest is the least likely to be looked at. No trainee's page displaces a
      // therapist's.
      const auto rank = [](const std::shared_ptr<ViewPage>& known) {
        return std::pair(known->role() == ViewRole::therapist, static_cast<PageConnection&>(*known).last_heard());
      };
      const auto silent = std::min_element(pages_.begin(), pages_.end(),
                                           [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
      if ((*silent)->role() == ViewRole::therapist && page->role() != ViewRole::therapist)
        return page->close(boost::beast::websocket::close_code::policy_error, "too many pages are open");
      const std::shared_ptr<ViewPage> leaving = *silent;
      leaving->close(boost::beast::websocket::close_code::policy_error, "too many pages are open");
      std::erase(pages_, leaving);
    }
    std::erase_if(strangers_, [&](const auto& stranger) { return stranger.lock() == page; });
    pages_.push_back(page);
  }

  void remove(PageConnection& page) noexcept override {
    std::erase_if(pages_, [&](const auto& known) { return known.get() == &page; });
  }

  void wait(Repeat& repeat) {
    repeat.timer.async_wait([this, &repeat](error_code cancelled) {
      if (cancelled || closing_) return;
      repeat.task();
      repeat.timer.expires_after(repeat.period);
      wait(repeat);
    });
  }

  /// Says goodbye to the pages, and ends the thread when they have taken it, or soon.
  void close() {
    closing_ = true;
    error_code ignored;
    for (Acceptor& acceptor : acceptors_) acceptor.socket.close(ignored);
    for (Acceptor& acceptor : acceptors_) acceptor.pause.cancel();
    for (Repeat& repeat : repeats_) repeat.timer.cancel();
    for (Visitor* visitor : std::list<Visitor*>(visitors_)) visitor->close();
    for (const auto& stranger : strangers_)
      if (const auto page = stranger.lock()) page->abort();
    for (const auto& page : std::vector<std::shared_ptr<ViewPage>>(pages_))
      page->close(boost::beast::websocket::close_code::going_away, "the session is over");
    limit_.expires_after(kGoodbye);
    limit_.async_wait([this](error_code cancelled) {
      if (!cancelled) io_.stop();
    });
    look_for_end();
  }

  void look_for_end() {
    if (pages_.empty()) {
      limit_.cancel();
      return;
    }
    ending_.expires_after(std::chrono::milliseconds(5));
    ending_.async_wait([this](error_code cancelled) {
      if (!cancelled) look_for_end();
    });
  }

  const Options options_;
  PageHandler& handler_;
  std::uint16_t port_ = 0;
  bool closing_ = false;
  std::list<Visitor*> visitors_;                        ///< oldest first
  std::list<std::weak_ptr<PageConnection>> strangers_;  ///< without a token so far; oldest first
  std::vector<std::shared_ptr<ViewPage>> pages_;
  asio::io_context io_{1};  ///< declared after what its handlers refer to
  std::list<Acceptor> acceptors_;
  std::list<Repeat> repeats_;
  asio::steady_timer limit_{io_}, ending_{io_};
  std::jthread thread_;
};

ViewServer::ViewServer(Options options, PageHandler& handler)
    : listeners_(std::make_unique<Listeners>(std::move(options), handler)) {}

ViewServer::~ViewServer() = default;

void ViewServer::start() {
  listeners_->start();
}

std::uint16_t ViewServer::port() const noexcept {
  return listeners_->port();
}

std::string ViewServer::address(ViewRole role) const {
  for (const auto& [known, token] : listeners_->options().tokens)
    if (known == role) return fmt::format("http://127.0.0.1:{}/#{}", port(), token);
  return {};
}

void ViewServer::post(std::function<void()> task) {
  asio::post(listeners_->io(), std::move(task));
}

void ViewServer::run(const std::function<void()>& task) {
  std::promise<void> done;
  asio::post(listeners_->io(), [&] {
    task();
    done.set_value();
  });
  done.get_future().wait();
}

void ViewServer::every(std::chrono::milliseconds period, std::function<void()> task) {
  listeners_->every(period, std::move(task));
}

const std::vector<std::shared_ptr<ViewPage>>& ViewServer::pages() const noexcept {
  return listeners_->pages();
}

}  // namespace haptrace
