#include "view/frames.h"

#include "view/view_time.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace haptrace {
namespace {

static_assert(std::endian::native == std::endian::little, "frames are copied as they are in memory");

template <class Value>
void append(std::string& body, const Value& value) {
  const std::size_t at = body.size();
  body.resize(at + sizeof value);
  std::memcpy(body.data() + at, &value, sizeof value);
}

void append_plane(std::string& body, std::span<const float> plane) {
  const std::size_t at = body.size();
  body.resize(at + plane.size_bytes());
  if (!plane.empty()) std::memcpy(body.data() + at, plane.data(), plane.size_bytes());
}

template <class Value>
Value value_at(std::string_view message, std::size_t offset) {
  Value value{};
  std::memcpy(&value, message.data() + offset, sizeof value);
  return value;
}

}  // namespace

std::array<char, kFrameHeader> frame_header(const Frame& frame, std::uint32_t sequence, std::uint16_t more_flags) {
  constexpr std::uint8_t kVersion = 1;
  std::array<char, kFrameHeader> header{};
  const auto put = [&header](std::size_t offset, const auto& value) {
    std::memcpy(header.data() + offset, &value, sizeof value);
  };
  put(0, frame.kind);
  put(1, kVersion);
  put(2, static_cast<std::uint16_t>(frame.flags | more_flags));
  put(4, sequence);
  put(8, frame.rows);
  put(12, frame.request);
  put(16, frame.t0);
  put(24, frame.sent);
  return header;
}

Frame frame_of(const ViewRows& rows, FrameKind kind) {
  Frame frame{.kind = kind};
  if (rows.size() == 0) return frame;
  const std::size_t first = kind == FrameKind::state ? rows.size() - 1 : 0, count = rows.size() - first;
  frame.rows = static_cast<std::uint32_t>(count);
  frame.t0 = seconds(rows.time_ns[first]);
  frame.body.reserve((rows.planes.size() + 1) * count * sizeof(float));
  for (std::size_t row = first; row < rows.size(); ++row)
    append(frame.body, static_cast<float>(seconds(rows.time_ns[row] - rows.time_ns[first])));
  for (const std::vector<float>& plane : rows.planes) append_plane(frame.body, std::span(plane).subspan(first));
  return frame;
}

Frame frame_of(const ViewBins& bins) {
  Frame frame{.kind = FrameKind::bins, .rows = static_cast<std::uint32_t>(bins.count), .t0 = seconds(bins.first_ns)};
  const std::size_t padded = (bins.count + 3) / 4 * 4;
  frame.body.reserve(16 + bins.channels.size() * (4 * sizeof(float) * bins.count + padded));
  append(frame.body, static_cast<std::uint32_t>(bins.channels.size()));
  append(frame.body, static_cast<std::uint32_t>(bins.count));
  append(frame.body, seconds(bins.width_ns));
  for (const std::vector<PyramidBin>& channel : bins.channels) {
    for (const auto member : {&PyramidCell::first, &PyramidCell::min, &PyramidCell::max, &PyramidCell::last})
      for (const PyramidBin& bin : channel) append(frame.body, bin.cell.*member);
    for (const PyramidBin& bin : channel) frame.body.push_back(bin.min_first ? '\1' : '\0');
    frame.body.append(padded - bins.count, '\0');
  }
  return frame;
}

Frame frame_of(const FollowedPath& path) {
  Frame frame{.kind = FrameKind::path};
  const std::size_t size = std::min(path.time.size(), path.position.size());
  std::vector<std::size_t> points;
  std::vector<double> length;  // of the path up to each of them
  for (std::size_t i = 0; i < size; ++i) {
    if (!is_finite(path.position[i])) continue;
    length.push_back(points.empty() ? 0 : length.back() + (path.position[i] - path.position[points.back()]).norm());
    points.push_back(i);
  }
  if (points.size() > kMostPathPoints) {
    std::vector<std::size_t> kept;
    std::vector<double> kept_length;
    const double step = length.back() / static_cast<double>(kMostPathPoints - 1);
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (length[i] < step * static_cast<double>(kept.size()) && i + 1 < points.size()) continue;
      if (kept.size() == kMostPathPoints) kept.pop_back(), kept_length.pop_back();
      kept.push_back(points[i]);
      kept_length.push_back(length[i]);
    }
    points = std::move(kept);
    length = std::move(kept_length);
  }
  frame.rows = static_cast<std::uint32_t>(points.size());
  const auto plane = [&](auto&& value) {
    for (const std::size_t point : points) append(frame.body, static_cast<float>(value(point)));
  };
  plane([&](std::size_t i) { return path.time[i]; });
  for (int axis = 0; axis < 3; ++axis) plane([&](std::size_t i) { return path.position[i][axis]; });
  plane([&](std::size_t i) { return i < path.radius.size() ? path.radius[i] : kNaN; });
  for (const double along : length) append(frame.body, static_cast<float>(along));
  return frame;
}

Frame frame_of(const TriangleMesh& mesh, std::uint32_t object) {
  Frame frame{.kind = FrameKind::mesh, .rows = static_cast<std::uint32_t>(mesh.vertices.size())};
  frame.body.reserve(8 + 12 * (mesh.vertices.size() + mesh.triangles.size()));
  append(frame.body, object);
  append(frame.body, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const Vec3& vertex : mesh.vertices)
    for (int axis = 0; axis < 3; ++axis) append(frame.body, static_cast<float>(vertex[axis]));
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle) append(frame.body, corner);
  return frame;
}

std::optional<PageIntention> parse_intention(std::string_view message) {
  constexpr std::size_t kBytes = kFrameHeader + 4 * sizeof(float) + 2 * sizeof(std::uint32_t);
  if (message.size() < kBytes || value_at<FrameKind>(message, 0) != FrameKind::intention) return std::nullopt;
  PageIntention intention;
  for (int axis = 0; axis < 3; ++axis)
    intention.position[axis] = value_at<float>(message, kFrameHeader + sizeof(float) * static_cast<std::size_t>(axis));
  intention.grip = value_at<float>(message, kFrameHeader + 3 * sizeof(float));
  intention.input = value_at<std::uint32_t>(message, kFrameHeader + 4 * sizeof(float));
  intention.depth = value_at<std::uint32_t>(message, kFrameHeader + 4 * sizeof(float) + sizeof(std::uint32_t));
  if (!is_finite(intention.position) || !std::isfinite(intention.grip)) return std::nullopt;
  intention.grip = std::clamp(intention.grip, 0.0, 1.0);
  return intention;
}

}  // namespace haptrace
