#include "view/page_connection.h"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using boost::system::error_code;

constexpr auto kFarewell = std::chrono::milliseconds(500);  // time for the page to answer a close
constexpr auto kSilence = std::chrono::seconds(30);         // longest silence, although the server pings
constexpr std::uint32_t kProtocol = 1;

}  // namespace

SharedText text_of(const nlohmann::json& json) {
  return std::make_shared<const std::string>(json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void ViewPage::send(const nlohmann::json& json) {
  send(text_of(json));
}

bool MessageBucket::take(Clock::time_point now) noexcept {
  if (last_ != Clock::time_point{})
    room_ = std::min(kRate, room_ + kRate * std::chrono::duration<double>(now - last_).count());
  last_ = now;
  if (room_ < 1) return false;
  room_ -= 1;
  return true;
}

PageConnection::PageConnection(asio::ip::tcp::socket socket, PageHandler& handler, PageRegistry& registry)
    : stream_(std::move(socket)), timer_(stream_.get_executor()), handler_(handler), registry_(registry) {}

void PageConnection::start(const Request& request, std::chrono::milliseconds patience) {
  error_code ignored;
  stream_.next_layer().set_option(asio::ip::tcp::no_delay(true), ignored);
  stream_.read_message_max(kLongestMessage);
  stream_.set_option(websocket::stream_base::timeout{
      .handshake_timeout = patience, .idle_timeout = kSilence, .keep_alive_pings = true});
  // Control frames count as messages, so that pings cannot flood the server.
  stream_.control_callback([this](websocket::frame_type, boost::beast::string_view) {
    if (!bucket_.take(Clock::now())) abort();
  });
  timer_.expires_after(patience);
  timer_.async_wait([self = shared_from_this()](error_code cancelled) {
    if (!cancelled && !self->admitted_) self->abort();
  });
  stream_.async_accept(request, [self = shared_from_this()](error_code error) {
    if (error || self->ended_) return self->ended();
    self->open_ = true;
    self->read();
  });
}

void PageConnection::read() {
  stream_.async_read(buffer_, [self = shared_from_this()](error_code error, std::size_t) {
    if (error || self->ended_) return self->ended();
    const auto data = self->buffer_.data();
    self->take({static_cast<const char*>(data.data()), data.size()}, self->stream_.got_text());
    self->buffer_.clear();
    if (!self->ended_) self->read();
  });
}

void PageConnection::take(std::string_view message, bool is_text) {
  if (goodbye_) return;
  last_heard_ = Clock::now();
  const bool in_time = bucket_.take(last_heard_);
  if (!admitted_) return greet(message, is_text);
  if (!is_text) {
    if (const auto intention = parse_intention(message); intention && in_time) handler_.steered(*this, *intention);
  } else if (const auto parsed = parse_page_message(message)) {
    // A stop is obeyed even from a page that sends too much.
    if (in_time || parsed->type == PageMessage::Type::stop) handler_.received(*this, *parsed);
  } else {
    send({{"type", "error"}, {"text", "the message is not valid; see docs/view-protocol.md"}});
  }
  if (!in_time) close(websocket::close_code::policy_error, "too many messages");
}

void PageConnection::greet(std::string_view message, bool is_text) {
  const auto hello = is_text ? parse_page_message(message) : std::nullopt;
  const auto role = hello && hello->type == PageMessage::Type::hello ? registry_.role_of(hello->token) : std::nullopt;
  if (!role) return close(websocket::close_code::policy_error, "the token is missing or wrong");
  if (hello->version != kProtocol)
    return close(websocket::close_code::policy_error, "the page is of another version; load it again");
  timer_.cancel();
  role_ = *role;
  admitted_ = true;
  registry_.admit(shared_from_this());
  handler_.joined(*this, *hello);
}

void PageConnection::send(SharedText text) {
  if (ended_ || goodbye_) return;
  text_bytes_ += text->size();
  texts_.push_back(std::move(text));
  if (text_bytes_ > kMostText) return abort();
  pump();
}

void PageConnection::answer(Frame frame) {
  if (ended_ || goodbye_) return;
  answer_bytes_ += frame.bytes();
  answers_.push_back({std::make_shared<const Frame>(std::move(frame)), 0, Clock::now()});
  pump();
}

void PageConnection::stream(SharedFrame frame) {
  if (ended_ || goodbye_) return;
  const Clock::time_point now = Clock::now();
  const bool waits = writing_ != Writing::nothing && now - writing_since_ > kMostDelay;
  const bool late = !data_.empty() && now - data_.front().since > kMostDelay;
  if (waits || late || data_bytes_ + frame->bytes() > kMostData) {
    gap_ = gap_ || !data_.empty();
    for (const Queued& queued : data_) {
      data_bytes_ -= queued.frame->bytes();
      gap_ = gap_ || (queued.flags & FrameFlags::kGap) != 0;
    }
    data_.clear();
  }
  data_bytes_ += frame->bytes();
  data_.push_back({std::move(frame), gap_ ? FrameFlags::kGap : std::uint16_t{0}, now});
  gap_ = false;
  pump();
}

void PageConnection::close(std::uint16_t code, std::string_view reason) {
  if (ended_ || goodbye_) return;
  if (!open_) return abort();
  constexpr std::size_t kLongestReason = 120;
  goodbye_ = websocket::close_reason(static_cast<websocket::close_code>(code),
                                     std::string(reason.substr(0, kLongestReason)).c_str());
  answers_.clear();
  data_.clear();
  timer_.expires_after(kFarewell);
  timer_.async_wait([self = shared_from_this()](error_code cancelled) {
    if (!cancelled) self->abort();
  });
  pump();
}

void PageConnection::abort() {
  error_code ignored;
  stream_.next_layer().close(ignored);
  ended();
}

void PageConnection::pump() {
  if (writing_ != Writing::nothing || ended_ || !open_) return;
  writing_since_ = Clock::now();
  if (!texts_.empty()) {
    write_text();
  } else if (goodbye_) {
    say_goodbye();
  } else if (!answers_.empty()) {
    writing_ = Writing::answer;
    write_frame(answers_.front());
    answers_.pop_front();
  } else if (!data_.empty()) {
    writing_ = Writing::data;
    write_frame(data_.front());
    data_.pop_front();
  }
}

void PageConnection::write_text() {
  writing_ = Writing::text;
  text_ = std::move(texts_.front());
  texts_.pop_front();
  stream_.text(true);
  stream_.async_write(asio::buffer(*text_),
                      [self = shared_from_this()](error_code error, std::size_t) { self->written(error.failed()); });
}

void PageConnection::write_frame(const Queued& queued) {
  frame_ = queued;
  header_ = frame_header(*frame_.frame, ++sequence_, frame_.flags);
  stream_.binary(true);
  const std::array<asio::const_buffer, 2> buffers{asio::buffer(header_), asio::buffer(frame_.frame->body)};
  stream_.async_write(buffers,
                      [self = shared_from_this()](error_code error, std::size_t) { self->written(error.failed()); });
}

void PageConnection::say_goodbye() {
  writing_ = Writing::close;
  stream_.async_close(*goodbye_, [self = shared_from_this()](error_code) { self->abort(); });
}

void PageConnection::written(bool failed) {
  if (writing_ == Writing::text) text_bytes_ -= text_->size();
  if (writing_ == Writing::answer) answer_bytes_ -= frame_.frame->bytes();
  if (writing_ == Writing::data) data_bytes_ -= frame_.frame->bytes();
  writing_ = Writing::nothing;
  text_.reset();
  frame_.frame.reset();
  if (failed) return ended();
  pump();
}

/// Forgets the page. Its pending operations end by themselves, which ends its life.
void PageConnection::ended() {
  if (std::exchange(ended_, true)) return;
  const auto self = shared_from_this();
  timer_.cancel();
  registry_.remove(*this);
  if (admitted_) handler_.left(*this);
  error_code ignored;
  stream_.next_layer().close(ignored);
}

}  // namespace haptrace
