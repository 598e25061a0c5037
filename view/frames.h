// Binary messages of the live view (docs/view-protocol.md). Private to view.
#pragma once

#include "base/triangle_mesh.h"
#include "base/types.h"
#include "player/session.h"
#include "view/history.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace haptrace {

enum class FrameKind : std::uint8_t { samples = 1, state = 2, bins = 3, path = 4, mesh = 5, intention = 8 };

/// Flags of a frame; they may be combined.
struct FrameFlags {
  static constexpr std::uint16_t kGap = 1, kBackfill = 2, kCut = 4, kCoarse = 8;
};

inline constexpr std::size_t kFrameHeader = 32;  // [bytes]

/// A binary message without its sequence number, which differs between connections.
struct Frame {
  FrameKind kind = FrameKind::samples;
  std::uint16_t flags = 0;
  std::uint32_t rows = 0;
  std::uint32_t request = 0;  ///< 0: unasked
  double t0 = 0;              ///< [s]
  double sent = 0;            ///< session time when sent [s]; 0 for recordings
  std::string body;

  [[nodiscard]] std::size_t bytes() const noexcept { return kFrameHeader + body.size(); }
};
using SharedFrame = std::shared_ptr<const Frame>;

/// Returns the header of a frame. `more_flags` are added.
std::array<char, kFrameHeader> frame_header(const Frame& frame, std::uint32_t sequence, std::uint16_t more_flags);

/// Returns a frame of rows: kind samples, or state for their last row alone.
Frame frame_of(const ViewRows& rows, FrameKind kind = FrameKind::samples);

/// Returns a frame of bins.
Frame frame_of(const ViewBins& bins);

inline constexpr std::size_t kMostPathPoints = 4000;

/// Returns a frame of a path of at most kMostPathPoints points, thinned evenly by arc length. Ignores points that are
/// not finite.
Frame frame_of(const FollowedPath& path);

/// Returns a frame of the mesh of an object of the scene.
Frame frame_of(const TriangleMesh& mesh, std::uint32_t object);

/// A page's message about the hand of its user.
struct PageIntention {
  Vec3 position = Vec3::Zero();  ///< in W [m]
  double grip = 0;               ///< 0 lets go, 1 holds
  std::uint32_t input = 0, depth = 0;
};

/// Returns the intention in a binary message of a page; nothing if the message is of another kind, too short, or has a
/// value that is not finite.
std::optional<PageIntention> parse_intention(std::string_view message);

}  // namespace haptrace
