//! The host's BVH builder: binned SAH.
