// The proxy of a ball on a mesh.
#include "control/norm.h"
#include "scene/shape/mesh.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

/// A ball that moves, and the triangles around it. All places are relative to the mesh.
class Mesh::Ball {
 public:
  Ball(const TriangleTree& tree, double radius) noexcept : tree_(tree), radius_(radius) {}

  /// Puts the centre somewhere.
  void put(const Vec3& centre) noexcept {
    centre_ = centre;
    known_ = false;
  }
  [[nodiscard]] const Vec3& centre() const noexcept { return centre_; }

  /// Moves the centre straight towards a place until the ball touches. Returns whether it got there.
  bool move(const Vec3& to) noexcept {
    if (known_ && is_near(to)) return advance(to, share_among_near(to));
    if (known_) {
      // Most ways are blocked near their start.
      const Vec3 way = to - centre_, out = centre_ - gathered_;
      const double length = norm_of(way), along = out.dot(way) / length;
      const double room = std::sqrt(std::max(0.0, along * along + margin_ * margin_ - out.squaredNorm())) - along;
      const Vec3 edge = centre_ + std::min(1.0, 0.999 * room / length) * way;
      if (is_near(edge) && !advance(edge, share_among_near(edge))) return false;
    }
    return advance(to, share_in_tree(to));
  }

  /// Looks at the triangles around the ball, and for movements of up to `margin` remembers those that it can meet.
  void look_around(double margin) noexcept {
    if (!is_near(centre_) || margin > 2 * margin_) gather(margin);
    if (known_) return;
    const double moved = norm_of(centre_ - gathered_);
    for (std::size_t i = 0; i < count_; ++i) {
      Near& near = near_[i];
      near.gap = near.gap_at_first - moved;
      near.exact = false;
      if (near.gap <= touching()) look_at(near);
    }
    known_ = true;
  }

  /// Returns the place nearest to `goal` that the planes allow at which the ball is held; the centre itself if
  /// rounding leaves no other.
  [[nodiscard]] Vec3 nearest_allowed(const Vec3& goal) const noexcept {
    constexpr int kMostPlanes = 24;  // each is the one that is violated most, so a few decide
    const Vec3 way = goal - centre_;
    Vec3 target = way;
    ConstraintPlanes planes;
    for (int added = 0; added < kMostPlanes; ++added) {
      const double rounding = 1e-12 * (radius_ + target.cwiseAbs().sum());
      double worst = rounding;
      const Near* plane = nullptr;
      for (std::size_t i = 0; i < count_; ++i) {
        const Near& near = near_[i];
        if (near.gap > touching()) continue;
        const double violated = -near.gap - near.normal.dot(target);
        if (violated > worst) {
          worst = violated;
          plane = &near;
        }
      }
      if (plane == nullptr) return centre_ + target;
      // Planes that the last place is not on no longer matter.
      std::size_t kept = 0;
      for (std::size_t i = 0; i < planes.count; ++i)
        if (planes.normal[i].dot(target) - planes.height[i] <= rounding) {
          planes.normal[kept] = planes.normal[i];
          planes.height[kept++] = planes.height[i];
        }
      planes.count = std::min<std::size_t>(kept, planes.normal.size() - 1);
      planes.normal[planes.count] = plane->normal;
      planes.height[planes.count++] = -plane->gap;
      target = nearest_in_front(way, planes);
    }
    return centre_;
  }

  [[nodiscard]] double radius() const noexcept { return radius_; }

 private:
  static constexpr double kOverlap = 1e-7;  // of a ball that touches, as a share of its radius
  static constexpr std::size_t kMostNear = 512;
  static constexpr int kMostSteps = 40;  // of Newton's method; it stays on the free side whenever it ends

  // Written before it is read: a tick cannot afford to clear them all.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  struct Near {
    std::uint32_t triangle;
    double gap_at_first;  // where the triangles were gathered
    double gap;           // at the centre; a lower bound if it is not exact
    bool exact;
    Vec3 normal;  // from the triangle to the centre, if the gap is exact
  };
  struct Gap {
    double gap;
    Vec3 normal;
  };

  [[nodiscard]] double touching() const noexcept { return kOverlap * radius_; }
  [[nodiscard]] Gap gap_of(std::uint32_t triangle, const Vec3& centre) const noexcept {
    const Face& face = tree_.face(triangle);
    const Vec3 out = centre - closest_on(face, centre).position;
    const double distance = norm_of(out);
    return {distance - radius_, distance > 0 ? Vec3(out / distance) : face.normal};
  }
  void look_at(Near& near) const noexcept {
    const Gap found = gap_of(near.triangle, centre_);
    near.gap = found.gap;
    near.exact = true;
    near.normal = found.normal;
  }

  /// Returns whether the remembered triangles are all that a ball there can meet.
  [[nodiscard]] bool is_near(const Vec3& place) const noexcept {
    return (place - gathered_).squaredNorm() <= margin_ * margin_;
  }

  bool advance(const Vec3& to, double share) noexcept {
    known_ = false;
    if (share >= 1)
      centre_ = to;
    else
      centre_ += share * (to - centre_);
    return share >= 1;
  }

  void gather(double margin) noexcept {
    gathered_ = centre_;
    for (margin_ = margin;; margin_ *= 0.25) {
      count_ = 0;
      bool full = false;
      tree_.each_near(centre_, radius_ + margin_, [&](std::uint32_t triangle) {
        if (full) return;
        const Gap found = gap_of(triangle, centre_);
        if (found.gap > margin_ + touching()) return;
        full = count_ == near_.size();
        if (!full) near_[count_++] = {triangle, found.gap, found.gap, true, found.normal};
      });
      if (!full) break;
      if (margin_ < touching()) {
        // So many triangles touch it at once that only some can be looked at. It does not move without a sweep.
        margin_ = -1;
        gathered_ = nan3();
        break;
      }
    }
    known_ = true;
  }

  /// Returns the share of a way at which the ball touches a triangle, if that is less than `best`. The distance is a
  /// convex function of the share, so Newton's method from the free side never passes the first touch.
  [[nodiscard]] double touch(std::uint32_t triangle, const Vec3& way, Gap at, double best) const noexcept {
    double share = 0;
    for (int step = 0; step < kMostSteps; ++step) {
      const double rate = at.normal.dot(way), room = at.gap + touching();
      if (rate >= 0) return best;
      if (room <= 0.5 * touching()) break;
      share -= room / rate;
      if (share >= best) return best;
      at = gap_of(triangle, centre_ + share * way);
    }
    return share;
  }

  /// Needs the gaps at the centre.
  [[nodiscard]] double share_among_near(const Vec3& to) noexcept {
    const Vec3 way = to - centre_;
    const double length = norm_of(way);
    double best = 1;
    for (std::size_t i = 0; i < count_; ++i) {
      Near& near = near_[i];
      if (near.gap > best * length) continue;
      if (!near.exact) look_at(near);
      best = touch(near.triangle, way, {near.gap, near.normal}, best);
    }
    return best;
  }

  [[nodiscard]] double share_in_tree(const Vec3& to) noexcept {
    const Vec3 way = to - centre_;
    double best = 1;
    const auto visit = [&](std::uint32_t triangle) {
      best = touch(triangle, way, gap_of(triangle, centre_), best);
      return best;
    };
    // A ball around a short way meets fewer boxes than the way with boxes that are wider by the radius.
    const double half = 0.5 * norm_of(way);
    if (half < radius_)
      tree_.each_near(centre_ + 0.5 * way, radius_ + half, visit);
    else
      tree_.each_along(centre_, to, radius_, visit);
    return best;
  }

  const TriangleTree& tree_;
  double radius_;
  Vec3 centre_ = nan3(), gathered_ = nan3();
  double margin_ = -1;
  bool known_ = false;  // the gaps at the centre
  std::size_t count_ = 0;
  // Written before it is read.
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init)
  std::array<Near, kMostNear> near_;
};

/// Finds a free place for a ball that touches the surface or is behind it when it is first seen. Returns whether there
/// is a contact.
bool Mesh::place_ball(const Vec3& to, Ball& ball) const noexcept {
  const double radius = ball.radius();
  const TriangleTree::Nearest nearest = tree_.nearest(to);
  if (!(nearest.distance2 < std::numeric_limits<double>::infinity())) return false;
  const Foot foot{nearest.triangle, nearest.point};
  const Vec3 normal = pseudo_normal(foot).stableNormalized();
  const Vec3 out = to - foot.point.position;
  const bool behind = is_closed() ? tree_.winding(to) != 0 : out.dot(normal) < 0;
  if (behind ? !is_closed() : norm_of(out) >= radius) return false;
  const auto is_free = [&](const Vec3& centre) {
    return !(tree_.nearest(centre, radius * radius).distance2 < radius * radius) &&
           !(is_closed() && tree_.winding(centre) != 0);
  };
  ball.put(foot.point.position + radius * (1 + 1e-9) * normal);
  if (is_free(ball.centre())) return true;
  // Too narrow there: out along the normal to the first place that is wide enough, and back.
  double step = radius;
  for (int i = 0; i < 64; ++i, step *= 1.5) {
    ball.put(foot.point.position + step * normal);
    if (!is_free(ball.centre())) continue;
    (void)ball.move(foot.point.position);
    return true;
  }
  return false;
}

/// Ends a contact with a ball that is free where the tool is, unless the reach still holds it.
void Mesh::leave(const ToolStep& step, Proxy& proxy) const noexcept {
  const bool lasts = proxy.touching && step.reach > 0, inside = proxy.began_inside;
  release(proxy);
  if (!lasts) return;
  approach(step, proxy);
  proxy.began_inside = proxy.touching && inside;
}

void Mesh::follow_ball(const ToolStep& step, Proxy& proxy) const noexcept {
  const double radius = step.radius;
  const Vec3& goal = step.to;
  Ball ball(tree_, radius);
  bool inside = proxy.touching && proxy.began_inside;
  const Vec3 start = proxy.touching ? proxy.position : step.from;
  double margin = 0.25 * radius;
  if (proxy.touching) {
    // On flat ground the proxy moves as far as the tool does along it.
    const Vec3 way = goal - start;
    margin = std::min(radius, 1.25 * norm_of(way - way.dot(proxy.normal) * proxy.normal) + 0.005 * radius);
    ball.put(start);
  } else if (!std::isnan(start.x())) {
    ball.put(start);
    if (ball.move(goal)) {
      proxy.known = false;
      return;
    }
  } else {
    proxy = {};
    if (!place_ball(goal, ball)) return;
    inside = true;
  }

  constexpr int kMostParts = 8;  // of the way for each plane that it meets
  for (int part = 0; part < kMostParts * rounds_; ++part) {
    ball.look_around(margin);
    const Vec3 before = ball.centre();
    const Vec3 target = ball.nearest_allowed(goal);
    if (ball.move(target) && target == goal) return leave(step, proxy);
    if ((ball.centre() - before).squaredNorm() <= 1e-16 * radius * radius) break;
  }
  const Vec3 back = ball.centre() - goal;
  const double distance = norm_of(back);
  if (!(distance > 0)) return leave(step, proxy);
  proxy.position = ball.centre();
  proxy.normal = back / distance;
  proxy.depth = distance;
  proxy.known = proxy.touching = true;
  proxy.began_inside = inside;
}

}  // namespace haptrace
