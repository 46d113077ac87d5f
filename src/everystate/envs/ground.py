"""Whether a body's world is the same from all sides."""

import mujoco
import numpy as np
from mujoco import mjtEq, mjtJoint, mjtObj, mjtTrn, mjtWrap

_UPRIGHT = 1 - 1e-6


def level(model: mujoco.MjModel) -> bool:
    """Whether one body moves freely on level ground, with nothing there to tell directions apart.

    Then turned about the vertical it does the same, turned. What is not known to be so is not.
    """
    free = np.flatnonzero(model.jnt_type == mjtJoint.mjJNT_FREE).tolist()
    if len(free) != 1 or (model.opt.gravity[:2] != 0).any() or (model.opt.wind != 0).any():
        return False
    root = model.body_rootid[model.jnt_bodyid[free[0]]]
    others = (model.body_rootid[model.jnt_bodyid] != root).any()
    return not (others or model.nmocap or _pushed(model, free[0]) or _held(model)) and _flat(model)


def _flat(model: mujoco.MjModel) -> bool:
    """Whether all that it can run into is level planes."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    fixed = model.body_weldid[model.geom_bodyid] == 0
    meets = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    paired = np.zeros(model.ngeom, bool)
    paired[model.pair_geom1], paired[model.pair_geom2] = True, True
    is_plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    up = data.geom_xmat[:, 8] > _UPRIGHT
    even = (model.pair_friction[:, 0] == model.pair_friction[:, 1]).all()
    return bool(even and (is_plane & up)[fixed & (meets | paired)].all())


def _pushed(model: mujoco.MjModel, free: int) -> bool:
    """Whether a motor acts along axes of the world: those of the free joint, or of a fixed site."""
    on_joint = np.isin(model.actuator_trntype, [mjtTrn.mjTRN_JOINT, mjtTrn.mjTRN_JOINTINPARENT])
    on_site = model.actuator_trntype == mjtTrn.mjTRN_SITE
    refers = on_site & (model.actuator_trnid[:, 1] >= 0)
    return bool(((on_joint & (model.actuator_trnid[:, 0] == free)) | refers).any())


def _held(model: mujoco.MjModel) -> bool:
    """Whether a constraint or a tendon ties it to a place in the world."""
    ties = np.isin(model.eq_type, [mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD])
    ends = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1)[ties]
    of_sites = (model.eq_objtype[ties] == mjtObj.mjOBJ_SITE)[:, None]
    bodies = np.where(of_sites, _site_bodies(model, ends), ends)
    wraps = np.isin(model.wrap_type, [mjtWrap.mjWRAP_SITE])
    through = _site_bodies(model, model.wrap_objid[wraps])
    every = np.concatenate([bodies.ravel(), through])
    return bool((model.body_weldid[every] == 0).any())


def _site_bodies(model: mujoco.MjModel, sites: np.ndarray) -> np.ndarray:
    if not model.nsite:
        return np.zeros_like(sites)
    return model.site_bodyid[np.clip(sites, 0, model.nsite - 1)]
