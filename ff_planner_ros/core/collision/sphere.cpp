#include "collision/sphere.hpp"

namespace ff {

Pose TumblingBody::pose(double time) const {
  const auto number = series_at(time);
  const Series& terms = series[number];
  Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1);
  for (auto k = terms.rows() - 2; k >= 0; --k) q = q * (time - begins[number]) + terms.row(k);
  const Eigen::Quaterniond attitude(q[3], q[0], q[1], q[2]);
  return {position + time * velocity, attitude.normalized().toRotationMatrix()};
}

Vector3 TumblingBody::place(const Vector3& point, double time) const {
  const auto number = series_at(time);
  const Series& terms = series[number];
  Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1);
  for (auto k = terms.rows() - 2; k >= 0; --k) q = q * (time - begins[number]) + terms.row(k);
  const Vector3 axis = q.head<3>().transpose();
  const Vector3 across = axis.cross(point);
  return position + time * velocity + point +
         2 / q.squaredNorm() * (q[3] * across + axis.cross(across));
}

Vector3 TumblingBody::speed(const Vector3& point, double time) const {
  const auto number = series_at(time);
  const Series& terms = series[number];
  const double after = time - begins[number];
  Eigen::Matrix<double, 1, 4> q = terms.row(terms.rows() - 1), rate = q * 0;
  for (auto k = terms.rows() - 2; k >= 0; --k) {
    rate = rate * after + q;
    q = q * after + terms.row(k);
  }
  const Vector3 axis = q.head<3>().transpose(), by = rate.head<3>().transpose();
  const Vector3 across = axis.cross(point), across_by = by.cross(point);
  return velocity +
         2 / q.squaredNorm() *
             (rate[3] * across + q[3] * across_by + by.cross(across) + axis.cross(across_by));
}

std::ptrdiff_t TumblingBody::series_at(double time) const {
  return std::upper_bound(begins.begin() + 1, begins.end(), time) - begins.begin() - 1;
}

Vector3 Sphere::center_at(double time) const {
  return body ? body->place(place, time) : center + time * velocity;
}

Eigen::AlignedBox3d Sphere::way(const Values& times) const {
  const Vector3 begin = center_at(times.minCoeff()), end = center_at(times.maxCoeff());
  Eigen::AlignedBox3d box(begin.cwiseMin(end), begin.cwiseMax(end));
  if (body)  // it may have swung by meanwhile
    for (const double time : times) box.extend(center_at(time));
  return box;
}

}  // namespace ff
