// Fields whose zeros are surfaces, and their Boolean combinations.
#pragma once

#include "control/path/path.h"
#include "scene/expression.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace haptrace {

/// A scalar field f in space; f < 0 is inside. Real-time: all functions.
class Field {
 public:
  virtual ~Field() = default;
  [[nodiscard]] virtual double value(const Vec3& place) const noexcept = 0;
  [[nodiscard]] virtual Slope slope(const Vec3& place) const noexcept = 0;
  [[nodiscard]] virtual Jet jet(const Vec3& place) const noexcept = 0;
  /// Returns bounds along the line from + t way, for t within `share`.
  [[nodiscard]] virtual Span along(const Vec3& from, const Vec3& way, Interval share) const noexcept = 0;
  [[nodiscard]] virtual Interval over(const Box& box) const noexcept = 0;
};

/// The field of an expression in x, y, z. Where the expression is not a number, as the root of a negative one, is
/// outside.
class ExpressionField final : public Field {
 public:
  explicit ExpressionField(Expression expression) : expression_(std::move(expression)) {}
  [[nodiscard]] double value(const Vec3& place) const noexcept override {
    const double value = expression_.value(place);
    return std::isnan(value) ? std::numeric_limits<double>::infinity() : value;
  }
  [[nodiscard]] Slope slope(const Vec3& place) const noexcept override { return expression_.slope(place); }
  [[nodiscard]] Jet jet(const Vec3& place) const noexcept override { return expression_.jet(place); }
  [[nodiscard]] Span along(const Vec3& from, const Vec3& way, Interval share) const noexcept override {
    return expression_.along(from, way, share);
  }
  [[nodiscard]] Interval over(const Box& box) const noexcept override;

 private:
  Expression expression_;
};

struct Metaball {
  Vec3 centre = Vec3::Zero();  ///< [m]
  double radius = 0.03;        ///< beyond which it has no effect [m]
  double weight = 1;           ///< at its centre; negative: it dents the others
};

/// The field threshold - sum weight (1 - (r / radius)^2)^3 of balls that flow together (after Nishimura et al. 1985 and
/// Wyvill et al. 1986), scaled so that it is about the distance near a single ball. Its curvature is continuous.
class MetaballField final : public Field {
 public:
  MetaballField(std::vector<Metaball> balls, double threshold);
  [[nodiscard]] double value(const Vec3& place) const noexcept override;
  [[nodiscard]] Slope slope(const Vec3& place) const noexcept override;
  [[nodiscard]] Jet jet(const Vec3& place) const noexcept override;
  [[nodiscard]] Span along(const Vec3& from, const Vec3& way, Interval share) const noexcept override;
  [[nodiscard]] Interval over(const Box& box) const noexcept override;

 private:
  std::vector<Metaball> balls_;
  double threshold_;
  double scale_ = 1;  ///< [m]
};

/// Part of a Boolean combination.
struct FieldNode {
  enum class Kind : std::uint8_t { field, least, most };
  Kind kind = Kind::field;
  double sign = 1;                     ///< -1: the outside of the field
  std::shared_ptr<const Field> field;  ///< of the kind `field`
  /// Radius of the fillet in the middle of a right-angled crease between fields that are distances [m]; 0: a crease.
  double blend = 0;
  std::vector<FieldNode> parts;  ///< of the kinds `least` (a union) and `most` (an intersection)
  std::uint32_t piece = 0;       ///< number of a smooth part, from 1; 0: it consists of pieces

  /// Returns the complement.
  [[nodiscard]] FieldNode negated() const;
};

/// A Boolean combination of fields. Its smooth parts are its pieces; between them the surface has creases.
///
/// Real-time: all but the constructor.
class FieldTree {
 public:
  static constexpr std::uint32_t kMostPieces = 255;

  /// Throws Error(input) when there are too many pieces.
  explicit FieldTree(FieldNode root);
  FieldTree(const FieldTree&) = delete;
  FieldTree& operator=(const FieldTree&) = delete;

  /// The value, and the piece whose value it is.
  struct Active {
    double value;
    std::uint32_t piece;
  };
  [[nodiscard]] double value(const Vec3& place) const noexcept;
  [[nodiscard]] Active active(const Vec3& place) const noexcept;
  [[nodiscard]] Slope slope(std::uint32_t piece, const Vec3& place) const noexcept;
  [[nodiscard]] Jet jet(std::uint32_t piece, const Vec3& place) const noexcept;
  [[nodiscard]] Span along(const Vec3& from, const Vec3& way, Interval share) const noexcept;
  [[nodiscard]] Interval over(const Box& box) const noexcept;
  [[nodiscard]] std::size_t pieces() const noexcept { return pieces_.size(); }

 private:
  void number(FieldNode& node);

  FieldNode root_;
  std::vector<const FieldNode*> pieces_;
};

}  // namespace haptrace
