// WebSocket connection of one page. Private to view.
#pragma once

#include "view/view_page.h"

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <utility>

namespace haptrace {

/// Limits the messages of a page: kRate a second on average, and as many at once.
class MessageBucket {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr double kRate = 240;  // [1/s]

  /// Returns false if the message is one too many.
  bool take(Clock::time_point now) noexcept;

 private:
  double room_ = kRate;
  Clock::time_point last_{};
};

class PageConnection;

/// Connections and their admission.
class PageRegistry {
 public:
  virtual ~PageRegistry() = default;
  /// Returns the role of a token; nothing if the token is wrong.
  [[nodiscard]] virtual std::optional<ViewRole> role_of(const std::string& token) const = 0;
  virtual void admit(const std::shared_ptr<PageConnection>& page) = 0;
  virtual void remove(PageConnection& page) noexcept = 0;
};

/// Lives as long as one of its operations is pending.
///
/// Text goes out first, then answers, then live data. Live data are dropped if the page leaves kMostData bytes, or any
/// for kMostDelay, unsent. The connection closes if kMostText bytes of text are unsent.
class PageConnection final : public ViewPage, public std::enable_shared_from_this<PageConnection> {
 public:
  using Clock = std::chrono::steady_clock;
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;

  static constexpr std::size_t kLongestMessage = 4096;                // from a page [bytes]
  static constexpr std::size_t kMostData = std::size_t{256} << 10U;   // [bytes]
  static constexpr std::size_t kMostText = std::size_t{1} << 20U;     // [bytes]
  static constexpr std::size_t kMostAnswers = std::size_t{4} << 20U;  // [bytes]
  static constexpr auto kMostDelay = std::chrono::seconds(1);

  PageConnection(boost::asio::ip::tcp::socket socket, PageHandler& handler, PageRegistry& registry);

  /// Accepts the upgrade. Closes the connection if no valid hello comes within `patience`.
  void start(const Request& request, std::chrono::milliseconds patience);

  [[nodiscard]] ViewRole role() const noexcept override { return role_; }
  using ViewPage::send;
  void send(SharedText text) override;
  void answer(Frame frame) override;
  void stream(SharedFrame frame) override;
  [[nodiscard]] bool is_busy() const noexcept override { return answer_bytes_ > kMostAnswers / 2; }
  void close(std::uint16_t code, std::string_view reason) override;

  /// Closes the socket at once, without a message.
  void abort();

  [[nodiscard]] Clock::time_point last_heard() const noexcept { return last_heard_; }

 private:
  struct Queued {
    SharedFrame frame;
    std::uint16_t flags;
    Clock::time_point since;
  };

  void read();
  void take(std::string_view message, bool is_text);
  void greet(std::string_view message, bool is_text);
  void pump();
  void write_text();
  void write_frame(const Queued& queued);
  void written(bool failed);
  void say_goodbye();
  void ended();

  boost::beast::websocket::stream<boost::asio::ip::tcp::socket> stream_;
  boost::asio::steady_timer timer_;  ///< patience for the hello, later for the close
  PageHandler& handler_;
  PageRegistry& registry_;
  boost::beast::flat_buffer buffer_;
  MessageBucket bucket_;
  Clock::time_point last_heard_ = Clock::now();
  ViewRole role_ = ViewRole::viewer;
  bool admitted_ = false, open_ = false, ended_ = false;
  std::optional<boost::beast::websocket::close_reason> goodbye_;

  std::deque<SharedText> texts_;
  std::deque<Queued> answers_, data_;
  std::size_t text_bytes_ = 0, answer_bytes_ = 0, data_bytes_ = 0;  ///< unsent, including what is being written
  bool gap_ = false;                                                ///< data were dropped before the next frame

  enum class Writing { nothing, text, answer, data, close };
  Writing writing_ = Writing::nothing;
  Clock::time_point writing_since_;
  SharedText text_;
  Queued frame_{};
  std::array<char, kFrameHeader> header_{};
  std::uint32_t sequence_ = 0;
};

}  // namespace haptrace
