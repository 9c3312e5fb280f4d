#include "collision/simplex.hpp"

namespace ff {

void Simplex::add(const Vector3& a, const Vector3& b, const Pose& first, const Pose& second) {
  vertex_[size++] = {first * a - second * b, a, b};
}

void Simplex::move(const Pose& first, const Pose& second) {
  for (int i = 0; i < size; ++i)
    vertex_[i].difference = first * vertex_[i].on_first - second * vertex_[i].on_second;
}

bool Simplex::reduce() {
  switch (size) {
    case 1:
      take(point(0));
      return true;
    case 2:
      take(segment(0, 1));
      return true;
    case 3:
      take(triangle(0, 1, 2));
      return true;
    default: {
      Part best;
      static constexpr int faces[4][4] = {{0, 1, 2, 3}, {0, 2, 3, 1}, {0, 3, 1, 2}, {1, 3, 2, 0}};
      for (const auto& [a, b, c, opposite] : faces) {
        const Vector3 normal = (difference(b) - difference(a)).cross(difference(c) - difference(a));
        const double origin = -difference(a).dot(normal);
        const double inside = (difference(opposite) - difference(a)).dot(normal);
        if (origin * inside > 1e-24) continue;  // behind this face, as the fourth vertex is
        const Part part = triangle(a, b, c);
        if (part.square < best.square) best = part;
      }
      if (best.size == 0) return false;
      take(best);
      return true;
    }
  }
}

Vector3 Simplex::weighted(Vector3 Vertex::* of) const {
  Vector3 sum = Vector3::Zero();
  for (int i = 0; i < size; ++i) sum += weight_[i] * (vertex_[i].*of);
  return sum;
}

void Simplex::take(const Part& part) {
  const std::array<Vertex, 4> before = vertex_;
  size = part.size;
  for (int i = 0; i < size; ++i) vertex_[i] = before[part.vertex[i]];
  weight_ = part.weight;
}

Simplex::Part Simplex::segment(int i, int j) const {
  const Vector3 along = difference(j) - difference(i);
  const double square = along.squaredNorm();
  const double t = square > 0 ? -difference(i).dot(along) / square : 0;
  if (t <= 0) return point(i);
  if (t >= 1) return point(j);
  return {(difference(i) + t * along).squaredNorm(), 2, {i, j}, {1 - t, t}};
}

Simplex::Part Simplex::triangle(int i, int j, int k) const {
  const Vector3 &a = difference(i), &b = difference(j), &c = difference(k);
  const Vector3 normal = (b - a).cross(c - a);
  const double square = normal.squaredNorm();
  const double u = b.cross(c).dot(normal), v = c.cross(a).dot(normal), w = a.cross(b).dot(normal);
  if (square > 1e-30 && u > 0 && v > 0 && w > 0) {
    const double sum = u + v + w, of_a = u / sum, of_b = v / sum, of_c = w / sum;
    return {(of_a * a + of_b * b + of_c * c).squaredNorm(), 3, {i, j, k}, {of_a, of_b, of_c}};
  }
  Part best = segment(i, j);
  for (const Part& part : {segment(j, k), segment(k, i)})
    if (part.square < best.square) best = part;
  return best;
}

}  // namespace ff
