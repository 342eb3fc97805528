"""Plans for the meshes of a job, which depend on meshes and tools alone, not on the clips that are baked."""

from wrinklecli.baking.job import Job
from wrinklecli.character.contacts import Neighbours
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.errors import BakeError


def plan_meshes(job: Job, *, influences: int | None = None) -> list[MeshPlan]:
    """Attach the tools of every mesh and refine it, as `plan_mesh` does.

    Raises:
        WrinkleError: Tools do not fit, a line for each.
    """
    neighbours = Neighbours(job.document)

    def plan(node: int) -> MeshPlan:
        return plan_mesh(
            job.document,
            node,
            job.by_node[node],
            job.settings,
            job.every_clip,
            job.options.max_error,
            influences=influences,
            max_vertices=job.options.max_vertices,
            neighbours=neighbours,
        )

    return BakeError.every(plan, job.by_node)
