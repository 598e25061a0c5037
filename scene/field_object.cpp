#include "scene/field_object.h"

#include "base/error.h"
#include "control/norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr double kReach = 0.01;     // longest depth of a contact [m]
constexpr double kWindow = 2;       // [samples]
constexpr double kMostEnergy = 10;  // [J]
constexpr double kMostDrag = 1e3;   // [N s/m]

/// A field has no surface.
class NoSurface final : public Surface {
 public:
  explicit NoSurface(std::vector<std::string> remarks) : remarks_(std::move(remarks)) {}
  [[nodiscard]] std::vector<std::string> remarks() const override { return remarks_; }
  [[nodiscard]] Contact press(const Press&, SurfaceMemory&) const noexcept override { return {}; }

 private:
  std::vector<std::string> remarks_;
};

/// The potential energy at a place, with its derivatives, and the drag.
struct Potential {
  FieldPoint energy;
  double drag = 0;
};

/// A step from 0 to 1 whose first two derivatives are zero at both ends.
TransferFunction::Value window(double t) noexcept {
  if (!(t > 0)) return {};
  if (t >= 1) return {1, 0, 0};
  return {t * t * t * (10 + t * (6 * t - 15)), 30 * t * t * (1 - t) * (1 - t), 60 * t * (1 - t) * (1 - 2 * t)};
}

/// Field, energy and drag of a volume.
class EnergyField {
 public:
  EnergyField(const VolumeData& data, FieldSpec spec)
      : spec_(std::move(spec)),
        field_(
            data, 3, [](float value) { return value; }, [](float border) { return border; }),
        index_(data.steps.inverse()) {}

  [[nodiscard]] Box bounds() const noexcept {
    Box box;
    for (unsigned corner = 0; corner < 8; ++corner) {
      Vec3 u = Vec3::Constant(ScalarField::kPad);
      for (unsigned axis = 0; axis < 3; ++axis)
        if (((corner >> axis) & 1U) != 0) u[static_cast<int>(axis)] = last(axis);
      box.include(field_.place_of(u));
    }
    return box;
  }

  /// Returns whether the window is open at a place.
  [[nodiscard]] bool covers(const Vec3& place) const noexcept {
    const Vec3 u = field_.index_of(place);
    for (unsigned axis = 0; axis < 3; ++axis)
      if (!(u[static_cast<int>(axis)] > ScalarField::kPad && u[static_cast<int>(axis)] < last(axis))) return false;
    return true;
  }

  [[nodiscard]] Potential at(const Vec3& place) const noexcept {
    const FieldPoint s = field_.at(place);
    const TransferFunction::Value energy = spec_.energy(s.value);
    const Vec3 u = field_.index_of(place);
    std::array<TransferFunction::Value, 3> one;
    for (unsigned axis = 0; axis < 3; ++axis) {
      const double low = u[static_cast<int>(axis)] - ScalarField::kPad, high = last(axis) - u[static_cast<int>(axis)];
      const double wide = std::min(kWindow, 0.5 * (last(axis) - ScalarField::kPad));
      one[axis] = window(std::min(low, high) / wide);
      one[axis].first *= (low < high ? 1 : -1) / wide;
      one[axis].second /= wide * wide;
    }
    const auto& [x, y, z] = one;
    const double w = x.value * y.value * z.value;
    const Vec3 slope = index_.transpose() *
                       Vec3(x.first * y.value * z.value, x.value * y.first * z.value, x.value * y.value * z.first);
    Eigen::Matrix3d bend;
    const double xy = x.first * y.first * z.value, xz = x.first * y.value * z.first, yz = x.value * y.first * z.first;
    bend << x.second * y.value * z.value, xy, xz, xy, x.value * y.second * z.value, yz, xz, yz,
        x.value * y.value * z.second;
    Potential potential;
    potential.energy.value = w * energy.value;
    potential.energy.gradient = w * energy.first * s.gradient + energy.value * slope;
    potential.energy.hessian = w * (energy.second * s.gradient * s.gradient.transpose() + energy.first * s.hessian) +
                               energy.first * (s.gradient * slope.transpose() + slope * s.gradient.transpose()) +
                               energy.value * (index_.transpose() * bend * index_);
    potential.drag = w * spec_.drag(s.value).value;
    return potential;
  }

  /// Returns a note on the largest force and stiffness at the samples, of which it looks at every n-th.
  [[nodiscard]] std::string extremes() const {
    constexpr double kLooks = 1e6;
    const auto& size = field_.size();
    const double count = static_cast<double>(size[0]) * size[1] * size[2];
    const int every = std::max(1, static_cast<int>(std::cbrt(count / kLooks)));
    double force = 0, stiffness = 0, drag = 0;
    for (int k = 0; k < size[2]; k += every)
      for (int j = 0; j < size[1]; j += every)
        for (int i = 0; i < size[0]; i += every) {
          const Vec3 place = field_.place_of(Vec3(i, j, k));
          if (!covers(place)) continue;
          const Potential potential = at(place);
          force = std::max(force, norm_of(potential.energy.gradient));
          stiffness = std::max(stiffness, potential.energy.hessian.norm());
          drag = std::max(drag, potential.drag);
        }
    return fmt::format("its field has forces up to {:.3g} N, stiffness up to {:.3g} N/m and drag up to {:.3g} N s/m",
                       force, stiffness, drag);
  }

 private:
  [[nodiscard]] double last(unsigned axis) const noexcept { return field_.size()[axis] - 1 - ScalarField::kPad; }

  FieldSpec spec_;
  ScalarField field_;
  Eigen::Matrix3d index_;
};

class FieldObject final : public Object {
 public:
  FieldObject(std::string name, std::string kind, std::unique_ptr<Volume> volume, EnergyField field, const Pose& pose)
      : Object(std::move(name), std::move(kind), std::move(volume),
               std::make_unique<NoSurface>(std::vector{field.extremes()})),
        field_(std::move(field)),
        pose_(pose) {}

  [[nodiscard]] Pose pose() const noexcept override { return pose_; }

  [[nodiscard]] Contact answer(const Touch& touch) noexcept override {
    if (!touch.valid()) return {};
    const Vec3 place = pose_.place_of(touch.position);
    Contact contact{.place = place};
    if (field_.covers(place)) feel(place, pose_.vector_of(touch.velocity), contact);
    // A field has no inside: only a force that is there at the first query grows softly, until it is zero once.
    proxy_.began_inside = !contact.force.isZero(0) && (proxy_.began_inside || std::isnan(touch.last_position.x()));
    if (proxy_.began_inside) soften(touch.dt, contact);
    pose_.to_world(contact);
    return contact;
  }

 private:
  void feel(const Vec3& place, const Vec3& velocity, Contact& contact) const noexcept {
    const Potential potential = field_.at(place);
    const double push = norm_of(potential.energy.gradient);
    contact.force = -potential.energy.gradient - potential.drag * velocity;
    contact.stored = potential.energy.value;
    contact.damping = potential.drag;
    contact.clings = potential.drag > 0;
    if (!(push > 0)) return;
    contact.normal = -potential.energy.gradient / push;
    contact.stiffness = std::max(push / kReach, contact.normal.dot(potential.energy.hessian * contact.normal));
    contact.depth = push / contact.stiffness;
    contact.proxy = place + contact.depth * contact.normal;
  }

  EnergyField field_;
  Pose pose_;
};

TransferFunction read_points(JsonReader& reader, const std::string& key, double most) {
  const nlohmann::json value = reader.value(key);
  if (value.is_null()) return {};
  const std::string where = reader.where() + "." + key;
  if (!value.is_array() || value.size() < 2)
    throw input_error(where + ": expected at least two points [value of the volume, " + key + "]");
  std::vector<TransferFunction::Point> points;
  for (const nlohmann::json& pair : value) {
    const std::string at = fmt::format("{}[{}]: ", where, points.size());
    if (!pair.is_array() || pair.size() != 2 || !pair[0].is_number() || !pair[1].is_number())
      throw input_error(fmt::format("{}expected two numbers [value of the volume, {}]", at, key));
    const TransferFunction::Point point{pair[0].get<double>(), pair[1].get<double>()};
    check_range(at + "the value of the volume", point.at, -1e30, 1e30);
    check_range(at + key, point.value, 0, most, key == "drag" ? "N s/m" : "J");
    if (!points.empty() && !(point.at > points.back().at))
      throw input_error(at + "the value of the volume must be above that of the point before");
    points.push_back(point);
  }
  return TransferFunction(std::move(points));
}

}  // namespace

TransferFunction::TransferFunction(std::vector<Point> points) : points_(std::move(points)), slopes_(points_.size(), 0) {
  for (std::size_t i = 1; i + 1 < points_.size(); ++i) {
    const double left = points_[i].at - points_[i - 1].at, right = points_[i + 1].at - points_[i].at;
    const double before = (points_[i].value - points_[i - 1].value) / left,
                 after = (points_[i + 1].value - points_[i].value) / right;
    // The weighted harmonic mean stays monotone.
    const double a = 2 * right + left, b = right + 2 * left;
    if (before * after > 0) slopes_[i] = (a + b) / (a / before + b / after);
  }
}

TransferFunction::Value TransferFunction::operator()(double at) const noexcept {
  if (points_.empty()) return {};
  if (!(at > points_.front().at)) return {points_.front().value, 0, 0};
  if (at >= points_.back().at) return {points_.back().value, 0, 0};
  const auto next = std::upper_bound(points_.begin(), points_.end(), at,
                                     [](double value, const Point& point) { return value < point.at; });
  const auto i = static_cast<std::size_t>(next - points_.begin()) - 1;
  const Point &a = points_[i], &b = points_[i + 1];
  const double width = b.at - a.at, t = (at - a.at) / width;
  const double rise = b.value - a.value, p = slopes_[i] * width, q = slopes_[i + 1] * width;
  const double c3 = p + q - 2 * rise, c2 = 3 * rise - 2 * p - q;
  return {a.value + t * (p + t * (c2 + t * c3)), (p + t * (2 * c2 + 3 * t * c3)) / width,
          (2 * c2 + 6 * t * c3) / (width * width)};
}

FieldSpec read_field(JsonReader reader) {
  FieldSpec spec{read_points(reader, "energy", kMostEnergy), read_points(reader, "drag", kMostDrag)};
  if (spec.energy.empty() && spec.drag.empty())
    throw input_error(reader.where() + ": give 'energy' or 'drag', or both");
  reader.finish();
  return spec;
}

std::unique_ptr<Object> make_field_object(std::string name, std::string kind, std::unique_ptr<Volume> volume,
                                          FieldSpec spec, const std::optional<Pose>& pose) {
  EnergyField field(*volume->data(), std::move(spec));
  volume->only_show(field.bounds());
  return std::make_unique<FieldObject>(std::move(name), std::move(kind), std::move(volume), std::move(field),
                                       pose.value_or(Pose{}));
}

}  // namespace haptrace
