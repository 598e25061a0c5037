// HTTP and WebSocket server of the live view, for pages on this machine. Private to view.
#pragma once

#include "view/page_assets.h"
#include "view/view_page.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace haptrace {

/// Serves the page and its WebSocket on 127.0.0.1 and, if possible, on ::1 at the same port. One thread.
///
/// Every request must name a loopback host literally, in Host and in Origin, so that neither another site nor a
/// rebound name in the same browser gets an answer. A WebSocket must send the token of a role in its first message.
/// Connections that have not done so are few, live only for the patience, and give way to new ones.
class ViewServer {
 public:
  struct Options {
    std::uint16_t port = 0;                                ///< 0: any free port
    std::vector<std::pair<ViewRole, std::string>> tokens;  ///< one token for each role that may connect
    std::span<const PageAsset> assets = page_assets();
    std::chrono::milliseconds patience{5000};  ///< time for a request, and from the connection to its first message
    std::size_t most_pages = 16;
  };

  /// Listens, but serves nobody before start(). `handler` must outlive this object. Throws Error(input) if the port is
  /// taken.
  ViewServer(Options options, PageHandler& handler);

  /// Closes all pages with code 1001 and ends the thread.
  ~ViewServer();
  ViewServer(const ViewServer&) = delete;
  ViewServer& operator=(const ViewServer&) = delete;

  /// Starts the thread, in which `handler` is called from then on: once, when the handler and all that it uses are
  /// complete.
  void start();

  [[nodiscard]] std::uint16_t port() const noexcept;

  /// Returns the address of the page for a role; empty if the role may not connect.
  [[nodiscard]] std::string address(ViewRole role) const;

  /// Runs `task` in the server's thread, soon. From any thread.
  void post(std::function<void()> task);

  /// Runs `task` in the server's thread and waits for its end. From any other thread, after start().
  void run(const std::function<void()>& task);

  /// Runs `task` in the server's thread again and again. Call before the first connection matters; from any thread.
  void every(std::chrono::milliseconds period, std::function<void()> task);

  /// Returns the pages that have shown their token. In the server's thread.
  [[nodiscard]] const std::vector<std::shared_ptr<ViewPage>>& pages() const noexcept;

 private:
  class Listeners;
  std::unique_ptr<Listeners> listeners_;
};

}  // namespace haptrace
