// A page that is connected to the live view, as the server's users see it. Private to view.
#pragma once

#include "view/frames.h"
#include "view/page_message.h"
#include "view/view_role.h"

#include <chrono>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace haptrace {

/// A text message, shared by the connections that it goes to.
using SharedText = std::shared_ptr<const std::string>;

/// Returns JSON as a text message. Bytes that are not UTF-8 become U+FFFD.
SharedText text_of(const nlohmann::json& json);

/// A connected page that has shown its token.
///
/// Threads: the server's.
class ViewPage {
 public:
  virtual ~ViewPage() = default;
  ViewPage() = default;
  ViewPage(const ViewPage&) = delete;
  ViewPage& operator=(const ViewPage&) = delete;

  [[nodiscard]] virtual ViewRole role() const noexcept = 0;

  /// Sends a control message. They are never dropped and precede everything else.
  virtual void send(SharedText text) = 0;
  void send(const nlohmann::json& json);

  /// Sends an answer to a request, or rows that follow a reconnect. These are not dropped.
  virtual void answer(Frame frame) = 0;

  /// Sends live data. They are dropped while the page is slow; the next frame then has the flag `gap`.
  virtual void stream(SharedFrame frame) = 0;

  /// Returns true if the page has too many answers unsent to ask for more.
  [[nodiscard]] virtual bool is_busy() const noexcept = 0;

  /// Closes the connection with a code of the WebSocket protocol.
  virtual void close(std::uint16_t code, std::string_view reason) = 0;

  PageWants wants = PageWants::none;
  std::size_t meshes_sent = 0;  ///< of the present scene
};

/// Takes what pages send. Called in the server's thread.
class PageHandler {
 public:
  virtual ~PageHandler() = default;
  virtual void joined(ViewPage& page, const PageMessage& hello) = 0;
  virtual void left(ViewPage& page) = 0;
  virtual void received(ViewPage& page, const PageMessage& message) = 0;
  virtual void steered(ViewPage& page, const PageIntention& intention) = 0;
};

}  // namespace haptrace
