// Where a page's requests are answered from: a running session or a recording. Private to view.
#pragma once

#include "view/frames.h"
#include "view/page_message.h"
#include "view/view_channels.h"
#include "view/view_time.h"

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace haptrace {

inline constexpr std::size_t kMostRows = 20000;  ///< of an answer
inline constexpr std::uint32_t kMostPixels = 8192;

/// A request for data of a stretch of time.
struct ViewRequest {
  enum class Kind { bins, rows };
  Kind kind = Kind::bins;
  std::uint32_t id = 0;
  double t0 = 0, t1 = 0;              ///< [s]
  std::uint32_t pixels = 1;           ///< largest number of bins
  std::vector<std::size_t> channels;  ///< of bins
};

/// Returns the request of a message for a source with these columns, or the reason why it is none.
std::variant<ViewRequest, std::string> request_of(const PageMessage& message, const ViewChannels& channels);

/// Answers requests. A coarse answer has the flag `coarse`; the page asks again.
class ViewSource {
 public:
  using Reply = std::function<void(Frame)>;

  virtual ~ViewSource() = default;

  /// Answers at once or later, in any thread. A source that cannot answer, for example because its file is damaged,
  /// answers with an empty frame.
  virtual void ask(const ViewRequest& request, const Reply& reply) = 0;
};

/// Returns the answer from rows in memory. `first_ns`, `last_ns`: extent of the data.
Frame answer_from(History& history, const ViewRequest& request, std::int64_t first_ns, std::int64_t last_ns);

/// Returns the text of the columns for the message `recording`.
nlohmann::json json_of(const ViewChannels& channels);

}  // namespace haptrace
