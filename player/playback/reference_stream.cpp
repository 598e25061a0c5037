#include "player/playback/reference_stream.h"

#include "base/error.h"
#include "control/path/path_smoothing.h"
#include "devices/loop/prefetcher.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

constexpr std::size_t kMostAhead = 64;  // pieces; bounds the memory for paths at many times their speed

/// Returns the number of pieces that pass in kAhead seconds, from 2 to kMostAhead.
std::size_t pieces_ahead(const TrajectoryPieces& pieces, double speed) {
  const double each = pieces.duration() / static_cast<double>(pieces.count());
  const double ahead = std::ceil(ReferenceStream::kAhead * speed / each);
  return std::clamp(static_cast<std::size_t>(std::min(ahead, 1e6)), std::size_t{2}, kMostAhead);
}

}  // namespace

TrajectoryPieces::TrajectoryPieces(std::shared_ptr<const PathSource> source, Interpolation interpolation,
                                   const Options& options)
    : source_(std::move(source)),
      interpolation_(interpolation),
      with_orientation_(options.orientation && source_->facts().orientation) {
  if (options.smoothing) check_range("the smoothing", *options.smoothing, 0, 1, "s");
  const PathFacts& facts = source_->facts();
  rows_ = facts.rows <= options.undivided ? facts.rows : options.rows;
  count_ = std::max<std::uint64_t>((facts.rows - 1 + rows_ - 1) / rows_, 1);
  whole_ = {.begin = facts.begin, .end = facts.end, .extent = facts.bounds.size().norm()};
  if (interpolation == Interpolation::cubic || interpolation == Interpolation::quintic) {
    const std::vector<Path> parts = stretches();
    whole_.smoothing = options.smoothing ? *options.smoothing : smoothing_time(parts);
    whole_.own_velocities = facts.velocity && Trajectory::agree(parts);
  }
  first_ = std::make_shared<const TrajectoryPiece>(make(0));
}

std::vector<Path> TrajectoryPieces::stretches() const {
  constexpr std::uint64_t kStretches = 8, kRows = 2048;
  const std::uint64_t rows = source_->facts().rows;
  std::vector<Path> stretches;
  if (rows <= kStretches * kRows)
    stretches.push_back(source_->read(0, rows));
  else
    for (std::uint64_t i = 0; i < kStretches; ++i)
      stretches.push_back(source_->read((rows - kRows) / (kStretches - 1) * i, kRows));
  return stretches;
}

TrajectoryPiece TrajectoryPieces::make(std::size_t index) const {
  const std::uint64_t first = index * rows_;
  return through(first, std::min(first + rows_, source_->facts().rows - 1));
}

TrajectoryPieces::Rows TrajectoryPieces::with_overlap(std::uint64_t first, std::uint64_t last) const {
  const std::uint64_t rows = source_->facts().rows;
  Rows needed{.begin = first - std::min(first, Trajectory::kOverlap),
              .end = std::min(last + 1 + Trajectory::kOverlap, rows)};
  if (whole_.smoothing > 0 && count_ > 1) {
    const double reach = smoothing_reach(whole_.smoothing);
    const auto time_of = [&](std::uint64_t row) { return source_->read(row, 1).time.front(); };
    needed.begin = std::min(needed.begin, source_->row_at(time_of(first) - reach));
    needed.end = std::max(needed.end, source_->row_at(time_of(last) + reach) + 1);
  }
  return needed;
}

TrajectoryPiece TrajectoryPieces::through(std::uint64_t first, std::uint64_t last) const {
  const auto [from, until] = with_overlap(first, last);
  const Path path = source_->read(from, until - from);
  Trajectory::Whole whole = whole_;
  whole.rows_before = from;
  TrajectoryPiece piece{.begin = path.time[first - from] - whole_.begin,
                        .end = path.time[last - from] - whole_.begin,
                        .trajectory = Trajectory(path, interpolation_, whole),
                        .orientation = {}};
  if (with_orientation_) piece.orientation = OrientationTrajectory(path, interpolation_, whole_.begin, whole_.end);
  return piece;
}

ReferenceStream::ReferenceStream(const TrajectoryPieces& pieces, const Check& check, double speed)
    : duration_(pieces.duration()),
      prefetcher_(std::make_unique<Prefetcher<TrajectoryPiece>>(
          pieces.first(), pieces.count(), pieces_ahead(pieces, speed),
          [pieces, check](std::size_t index) {
            auto piece = std::make_unique<const TrajectoryPiece>(pieces.make(index));
            if (check) check(*piece);
            return piece;
          })),
      count_(pieces.count()),
      piece_(prefetcher_->get(0)) {}

ReferenceStream::ReferenceStream(Trajectory trajectory) : duration_(trajectory.duration()) {
  auto piece = std::make_shared<TrajectoryPiece>(TrajectoryPiece{0, duration_, std::move(trajectory), {}});
  prefetcher_ = std::make_unique<Prefetcher<TrajectoryPiece>>(std::move(piece), 1, 0, nullptr);
  piece_ = prefetcher_->get(0);
}

ReferenceStream::ReferenceStream(ReferenceStream&&) noexcept = default;
ReferenceStream& ReferenceStream::operator=(ReferenceStream&&) noexcept = default;
ReferenceStream::~ReferenceStream() = default;

const std::string& ReferenceStream::error() const noexcept {
  return prefetcher_->error();
}

ReferenceStream::Answer ReferenceStream::sample(double t, Reference& reference) noexcept {
  if (t < piece_->begin) piece_ = prefetcher_->get(index_ = 0);
  while (t > piece_->end && index_ + 1 < count_) {
    const TrajectoryPiece* next = prefetcher_->get(index_ + 1);
    if (next == nullptr) return prefetcher_->failed(index_ + 1) ? Answer::unreadable : Answer::waiting;
    piece_ = next;
    ++index_;
    cursor_ = orientation_cursor_ = {};
  }
  reference = piece_->trajectory.sample(t, cursor_);
  return Answer::ready;
}

void ReferenceStream::wait(double t) noexcept {
  double end = piece_->end;
  for (std::size_t i = index_ + 1; t > end && i < count_ && i <= index_ + prefetcher_->ahead(); ++i) {
    prefetcher_->wait(i);
    const TrajectoryPiece* piece = prefetcher_->peek(i);
    if (piece == nullptr) return;
    end = piece->end;
  }
}

}  // namespace haptrace
