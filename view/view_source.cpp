#include "view/view_source.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace haptrace {

std::variant<ViewRequest, std::string> request_of(const PageMessage& message, const ViewChannels& channels) {
  ViewRequest request{.id = message.id, .t0 = message.t0, .t1 = message.t1};
  if (request.t1 < request.t0) return "t1 is before t0";
  if (message.type == PageMessage::Type::rows) {
    request.kind = ViewRequest::Kind::rows;
    return request;
  }
  request.pixels = std::clamp(message.pixels, std::uint32_t{1}, kMostPixels);
  for (const std::string& name : message.channels) {
    const auto index = channels.find(name);
    if (!index) return fmt::format("this recording has no column '{}'", name);
    request.channels.push_back(*index);
  }
  return request;
}

Frame answer_from(History& history, const ViewRequest& request, std::int64_t first_ns, std::int64_t last_ns) {
  const std::int64_t from = std::clamp(nanoseconds(request.t0), first_ns, std::max(first_ns, last_ns));
  const std::int64_t to = std::clamp(nanoseconds(request.t1), from, std::max(from, last_ns));
  Frame frame;
  if (request.kind == ViewRequest::Kind::rows) {
    bool cut = false;
    const bool outside = nanoseconds(request.t1) < first_ns || nanoseconds(request.t0) > last_ns;
    const ViewRows rows = outside ? ViewRows() : history.rows(from, to, kMostRows, cut);
    frame = frame_of(rows);
    if (cut) frame.flags |= FrameFlags::kCut;
  } else {
    frame = frame_of(history.bins(from, to, history.bin_width(from, to, request.pixels), request.channels));
  }
  frame.request = request.id;
  return frame;
}

nlohmann::json json_of(const ViewChannels& channels) {
  nlohmann::json columns = nlohmann::json::array();
  for (std::size_t i = 0; i < channels.size(); ++i)
    columns.push_back({{"name", channels[i].name}, {"unit", channels[i].unit}});
  return columns;
}

}  // namespace haptrace
